"""Jobs of the calibration worker."""

from __future__ import annotations

from functools import partial

from app.runtime.jobs import Report
from app.workers.calibration.image_archive import ImageArchive
from app.workers.calibration.messages import (
    BoardsFound,
    FindBoards,
    Fitted,
    FitViews,
    Job,
    Refined,
    RefineRows,
    Result,
)
from observer.calibration.ageing.row_refinement import RefinementRefusal, refine_from_scene
from observer.calibration.boards.board import BoardSighting
from observer.calibration.boards.board_images import BoardPair, find_boards
from observer.calibration.boards.board_pictures import small_picture
from observer.calibration.fitting.fit import fit_stereo
from observer.calibration.formats.opencv_file import calibration_text, read_calibration
from observer.calibration.report import fit_report
from observer.calibration.verdict import judge
from observer.errors import CalibrationError
from observer.image_files.reading import decoded_image


def do_job(job: Job, progress: Report) -> Result:
    """Do one job and return its result.

    Raises:
        CalibrationError: it cannot be done; one sentence says why.
    """
    if isinstance(job, FitViews):
        return _fit(job, progress)
    if isinstance(job, FindBoards):
        return _find(job, progress)
    return _refine(job)


def _fit(job: FitViews, progress: Report) -> Fitted:
    fit = fit_stereo(
        job.views,
        job.board,
        job.width,
        job.height,
        distortion_model=job.distortion_model,
        progress=progress,
    )
    report = fit_report(fit, judge(fit, job.frame_rate))
    return Fitted(calibration_text(fit.calibration), report)


def _refine(job: RefineRows) -> Refined:
    calibration = read_calibration(job.calibration_yaml, name=job.name)
    if not job.pairs:
        raise CalibrationError(
            "there are no images for the refinement yet; let the cameras run for a few seconds"
        )
    refined = refine_from_scene(calibration, job.pairs, job.vergence)
    if isinstance(refined, RefinementRefusal):
        raise CalibrationError(refined.reason)
    return Refined(calibration_text(refined.calibration), refined)


def _find(job: FindBoards, progress: Report) -> BoardsFound:
    with ImageArchive(job.archive) as archive:
        pairs = {pair.name: pair for pair in archive.pairs}
        found = find_boards(
            [
                BoardPair(
                    pair.name,
                    pair.left,
                    pair.right,
                    partial(archive.read, pair.left),
                    partial(archive.read, pair.right),
                )
                for pair in archive.pairs
            ],
            job.board,
            progress=progress,
        )
        refused = [*archive.refused, *(f"{each.name}: {each.reason}" for each in found.refused)]
        views, pictures = [], []
        for view in found.views:
            if view.left is None and view.right is None:
                refused.append(f"{view.name}: the board was not found in either image")
                continue
            views.append(view)
            pair = pairs[view.name]
            left = _picture(archive, pair.left, view.left)
            pictures.append((left, _picture(archive, pair.right, view.right)))
    return BoardsFound(tuple(views), tuple(pictures), found.width, found.height, tuple(refused))


def _picture(archive: ImageArchive, name: str, seen: BoardSighting | None) -> bytes:
    return small_picture(decoded_image(archive.read(name), name=name, grey=True), seen)
