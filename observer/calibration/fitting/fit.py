"""Calibration of a pair from many views of a board, and its uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from observer.calibration.boards.board import Board, BoardView
from observer.calibration.fitting.adjustment import Corners, StereoModel, adjust
from observer.calibration.fitting.flatness import board_bend
from observer.calibration.fitting.held_out import (
    Folds,
    fit_folds,
    held_out,
    reprojection,
    richer_is_better,
)
from observer.calibration.fitting.initialization import (
    FIRST_SOFT_PX,
    begin_camera,
    begin_pair,
    with_poses,
)
from observer.calibration.fitting.lens import DISTORTION_SIZE
from observer.calibration.fitting.outlier_views import (
    ViewError,
    explained,
    limit_px,
    outliers,
    posed,
    rms,
    soft_threshold,
    stray_corners,
    view_errors,
    whole_errors,
)
from observer.calibration.fitting.plausible import check_camera, check_pair
from observer.calibration.fitting.sightings import corners_of, refused_sightings, without
from observer.calibration.fitting.stereo_fit import DepthBias, StereoFit
from observer.calibration.fitting.uncertainty import depth_covariance, error_covariance, interval_95
from observer.camera import DistortionModel
from observer.errors import CalibrationError
from observer.geometry import Float64Array

# Two lenses and the right camera's pose are two dozen numbers; fewer views leave no check on them.
FEWEST_PAIRS = 5
# How many distortion terms are estimated at first; the others must prove their worth.
_FIRST_TERMS: dict[DistortionModel, int] = {"radtan": 4, "equidistant": 2}
# Cells of an image, across and down, by which its coverage is measured.
_CELLS = (5, 4)
_ROUNDS = 40

Progress = Callable[[str, float], None]


def fit_stereo(
    views: Sequence[BoardView],
    board: Board,
    width: int,
    height: int,
    *,
    distortion_model: DistortionModel = "radtan",
    progress: Progress | None = None,
) -> StereoFit:
    """Calibrate a pair of cameras from views of a board.

    Each camera is fitted alone first, then both together over all lenses, the right camera's pose
    and all poses of the board (``adjustment``). Views that only one camera saw serve that camera.
    A view that fits far worse than the others is refused with the reason, and the fit repeated.
    fx and fy are independent. Of the distortion, k1 k2 p1 p2 (k1 k2 of a fisheye lens) are always
    estimated, k3 (k3 k4) only if it makes held-out views clearly better.

    Args:
        width, height: of the images, pixels.
        progress: called with words and the share done, from 0 to 1.

    Raises:
        CalibrationError: one sentence on what is missing or impossible, and what to do.
    """
    report = progress or (lambda _words, _share: None)
    report("checking the views", 0.0)
    work = _Work(views, board, (width, height), distortion_model, report)
    model, soft_px = work.pair(work.camera_alone(0), work.camera_alone(1))
    usable = work.usable()
    corners = corners_of(work.views, board, usable)
    both = _both(corners, len(views))
    model, folds = work.with_supported_terms(model, corners, both, soft_px)
    report("fitting both cameras to all views", 0.9)
    found = adjust(model, corners, soft_px=soft_px)
    check_pair(found, np.flatnonzero(usable))
    assert found.covariance is not None
    report("computing the uncertainty", 0.93)
    covariance = error_covariance(found, corners, board, soft_px)
    # Step of the finite differences: small against the curvature, large against the rounding of
    # inverted distortion.
    near = 0.5 * np.sqrt(np.diag(found.covariance))
    depth = depth_covariance(found.model, covariance, near)
    errors = view_errors(found.residuals, corners, len(views))
    report("done", 1.0)
    return StereoFit(
        calibration=found.model.calibration,
        board=board,
        rms_left=rms(found.residuals[0]),
        rms_right=rms(found.residuals[1]),
        rms_stereo=rms(np.concatenate(found.residuals)),
        views=tuple(
            work.refused.get(index) or _view_error(view, work.views[index], errors[index])
            for index, view in enumerate(views)
        ),
        pairs=int(np.count_nonzero(both)),
        interval_95=interval_95(found.model, covariance, near),
        depth_bias=DepthBias((tuple(depth.ravel().tolist()),)),
        held_out=None if folds is None else held_out(folds, corners),
        coverage=(_coverage(corners[0], found.model.size), _coverage(corners[1], found.model.size)),
        bend=board_bend(found.model, corners, board, found.scatter_px),
    )


class _Work:
    """State of one fit.

    ``refused`` collects the views that turn out bad, and ``views`` lose bad corners.
    """

    def __init__(
        self,
        views: Sequence[BoardView],
        board: Board,
        size: tuple[int, int],
        model: DistortionModel,
        report: Progress,
    ) -> None:
        self.views, self._board = list(views), board
        self._size, self._model, self._report = size, model, report
        self.refused = refused_sightings(views, board, *size)
        self._free = np.arange(4 + DISTORTION_SIZE[model]) < 4 + _FIRST_TERMS[model]

    def usable(self) -> NDArray[np.bool_]:
        """(V,) which views are not refused."""
        out = np.ones(len(self.views), np.bool_)
        out[list(self.refused)] = False
        return out

    def camera_alone(self, camera: int) -> StereoModel:
        """Fit one camera by itself."""
        side = ("left", "right")[camera]
        self._report(f"fitting the {side} camera", 0.02 + 0.2 * camera)
        corners = self._corners(camera)
        found = begin_camera(corners, len(self.views), self._model, self._size, self._free)
        for turn in range(_ROUNDS):
            self._report(f"fitting the {side} camera", 0.1 + 0.2 * camera + min(0.1, turn / 100))
            soft_px = soft_threshold(found.residuals)
            found = adjust(found.model, [corners], soft_px=soft_px)
            strays = stray_corners(found.residuals[0], corners, soft_px)
            if strays.any():
                self.views = without(self.views, camera, corners, strays)
                corners = self._corners(camera)
                continue
            errors = view_errors(found.residuals, [corners], len(self.views))[:, 0]
            bad = outliers(errors)
            if not bad.any():
                break
            usual, _ = limit_px(errors)
            for index in np.flatnonzero(bad).tolist():
                off = float(errors[index])
                reason = (
                    f"its corners are off by {off:.1f} px in the {side} image ({usual:.1f} px in "
                    "other views): the board moved or was detected wrongly"
                )
                both = (off, None) if camera == 0 else (None, off)
                self.refused[index] = ViewError(self.views[index].name, False, reason, *both)
            corners = self._corners(camera)
            found = adjust(with_poses(found.model, 0, corners), [corners], soft_px=soft_px)
        seen = np.unique(corners.view)
        check_camera(found, seen, f"the {side} camera")
        return found.model

    def pair(self, left: StereoModel, right: StereoModel) -> tuple[StereoModel, float]:
        """Fit both cameras; also return the length, px, from which residuals are outliers."""
        self._report("fitting both cameras", 0.45)
        views, usable = len(self.views), self.usable()
        corners = corners_of(self.views, self._board, usable)
        both = _both(corners, views)
        self._require_pairs(both, None)
        model, agree = begin_pair(left, right, corners, both)
        kept = usable & (agree | ~both)
        soft_px, again = FIRST_SOFT_PX, usable.copy()
        for turn in range(_ROUNDS):
            self._report("fitting both cameras", 0.47 + min(0.15, turn / 100))
            self._require_pairs(kept & both, both)
            used = (corners[0].of_views(kept), corners[1].of_views(kept))
            soft_px = soft_threshold(adjust(model, used, soft_px=soft_px, iterations=5).residuals)
            found = adjust(model, used, soft_px=soft_px)
            model = found.model
            errors = whole_errors(found.residuals, used, views)
            bad = outliers(errors)
            if bad.any():
                kept &= ~bad
                continue
            usual, limit = limit_px(errors)
            # A view that did not agree with the first guess, or that worse views made look bad, may
            # fit after all; each view gets one such chance.
            waiting = usable & ~kept & again
            again &= ~waiting
            if not waiting.any():
                break
            late, own = posed(model, corners, waiting, soft_px)
            back = waiting & (whole_errors(late.residuals, own, views) <= limit)
            if not back.any():
                break
            kept |= back
            model = replace(
                model,
                board_R=np.where(back[:, None, None], late.model.board_R, model.board_R),
                board_t=np.where(back[:, None], late.model.board_t, model.board_t),
            )
        for index in np.flatnonzero(usable & ~kept).tolist():
            name = self.views[index].name
            self.refused[index] = explained(
                model, corners, index, name, usual, soft_px, self._board
            )
        return model, soft_px

    def with_supported_terms(
        self,
        model: StereoModel,
        corners: tuple[Corners, Corners],
        both: NDArray[np.bool_],
        soft_px: float,
    ) -> tuple[StereoModel, Folds | None]:
        """Return the model with as many distortion terms as held-out views confirm."""
        words = "validating on held-out views"

        def report(begin: float) -> Callable[[float], None]:
            return lambda share: self._report(words, begin + 0.12 * share)

        simple = fit_folds(model, corners, both, soft_px, report(0.65))
        if simple is None:
            return model, None
        every = replace(model, free=np.ones_like(model.free))
        rich = fit_folds(
            adjust(every, corners, soft_px=soft_px).model, corners, both, soft_px, report(0.77)
        )
        if rich is not None and richer_is_better(
            reprojection(simple, corners, soft_px), reprojection(rich, corners, soft_px)
        ):
            return every, rich
        return model, simple

    def _corners(self, camera: int) -> Corners:
        """Return the corners of one camera in the usable views.

        Raises:
            CalibrationError: there are too few views.
        """
        corners = corners_of(self.views, self._board, self.usable())[camera]
        self._require(
            len(np.unique(corners.view)), f"in which the {('left', 'right')[camera]} camera sees"
        )
        return corners

    def _require_pairs(self, pairs: NDArray[np.bool_], among: NDArray[np.bool_] | None) -> None:
        count = int(np.count_nonzero(pairs))
        if among is not None and count < max(FEWEST_PAIRS, np.count_nonzero(among) / 2):
            raise CalibrationError(
                f"only {count} of {np.count_nonzero(among)} views agree on the position of the "
                "right camera; check that left and right images are synchronized and that the "
                "cameras are rigidly connected, then capture the pairs again"
            )
        self._require(count, "in which both cameras see")

    def _require(self, count: int, words: str) -> None:
        if count >= FEWEST_PAIRS:
            return
        why = next(iter(self.refused.values()), None)
        refusal = "" if why is None else f" (view {why.name}: {why.reason})"
        raise CalibrationError(
            f"there {'is' if count == 1 else 'are'} {count or 'no'} "
            f"view{'' if count == 1 else 's'} {words} the board{refusal}; at least {FEWEST_PAIRS} "
            "are needed, and 15 or more are recommended"
        )


def _both(corners: tuple[Corners, Corners], views: int) -> NDArray[np.bool_]:
    """(V,) which views both cameras saw."""
    return np.asarray(
        np.isin(np.arange(views), corners[0].view) & np.isin(np.arange(views), corners[1].view)
    )


def _view_error(given: BoardView, view: BoardView, errors: Float64Array) -> ViewError:
    left, right = (float(e) if np.isfinite(e) else None for e in errors)
    pairs = ((given.left, view.left), (given.right, view.right))
    strays = sum(len(a) - len(b) for a, b in pairs if a is not None and b is not None)
    return ViewError(given.name, True, None, left, right, strays)


def _coverage(corners: Corners, size: tuple[int, int]) -> float:
    """Share of the image's cells that hold a corner."""
    cell = np.floor(corners.px / size * _CELLS).astype(np.intp)
    cell = np.clip(cell, 0, np.array(_CELLS) - 1)
    return len(np.unique(cell, axis=0)) / (_CELLS[0] * _CELLS[1])
