"""``dynamic-observer calibrate``: compute and judge a calibration from image pairs of a board."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.cli.output import whole_text
from app.cli.progress import progress_bar
from observer.errors import InputError
from observer.intervals import half_95

if TYPE_CHECKING:
    from observer.calibration.boards.board_images import FoundBoards
    from observer.calibration.fitting.stereo_fit import StereoFit
    from observer.calibration.verdict import CalibrationVerdict

# Detection uses both cores; the fit takes roughly the remaining share of the steps.
_WORKERS = 2
_STEPS, _LOOKING = 1000, 600


def calibrate(
    left: Annotated[
        str, typer.Argument(help="Quoted pattern of the left images, for example 'left/*.png'.")
    ],
    right: Annotated[str, typer.Argument(help="Pattern of the right images.")],
    board: Annotated[
        str, typer.Option(help="Columns and rows of inner corners of the board, for example 9x6.")
    ],
    square_mm: Annotated[
        float, typer.Option(help="Side of a square in millimetres, measured on the print.")
    ],
    output: Annotated[Path, typer.Option(help="Output file for the calibration (OpenCV YAML).")],
    charuco: Annotated[
        bool, typer.Option("--charuco", help="The board is a ChArUco board (DICT_4X4_250).")
    ] = False,
    fisheye: Annotated[
        bool, typer.Option("--fisheye", help="Use the fisheye lens model (equidistant).")
    ] = False,
    frame_rate: Annotated[
        float,
        typer.Option(min=0.1, max=1000, help="Frame rate of the cameras, for the stated delays."),
    ] = 30.0,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the result as JSON instead of text.")
    ] = False,
) -> None:
    """Calibrate a stereo camera from images of a board.

    Also states what the camera can detect.
    """
    # Importing them loads OpenCV and SciPy, which takes seconds.
    from observer.calibration.boards.board import Board, parse_board_size
    from observer.calibration.boards.board_images import find_boards, read_board_pairs
    from observer.calibration.fitting.fit import fit_stereo
    from observer.calibration.formats.opencv_file import calibration_text
    from observer.calibration.report import fit_report
    from observer.calibration.verdict import judge

    columns, rows = parse_board_size(board)
    shown = Board("charuco" if charuco else "chessboard", columns, rows, square_mm / 1e3)
    pairs, unpaired = read_board_pairs(left, right)
    # Checked before seconds of work, not after.
    if not output.parent.is_dir():
        raise InputError(f"cannot write {output}: name a file in an existing folder")
    with progress_bar(f"calibrating with {len(pairs)} pairs") as advance:

        def part(begin: int, length: int) -> Callable[[str, float], None]:
            return lambda _words, share: advance(begin + round(share * length), _STEPS)

        found = find_boards(pairs, shown, workers=_WORKERS, progress=part(0, _LOOKING))
        fit = fit_stereo(
            found.views,
            shown,
            found.width,
            found.height,
            distortion_model="equidistant" if fisheye else "radtan",
            progress=part(_LOOKING, _STEPS - _LOOKING - 10),
        )
        verdict = judge(fit, frame_rate)
    for refused in (*unpaired, *found.refused):
        typer.echo(f"rejected {refused.name}: {refused.reason}", err=True)
    _tell_views(found, fit)
    with whole_text(output) as file:
        file.write(calibration_text(fit.calibration))
    typer.echo(f"wrote {output}", err=True)
    if as_json:
        report = fit_report(fit, verdict)
        report["refused_images"] = [
            {"name": each.name, "reason": each.reason} for each in (*unpaired, *found.refused)
        ]
        typer.echo(json.dumps(report, allow_nan=False, indent=2))
        return
    typer.echo("\n".join(_words(fit, verdict)))


def _tell_views(found: FoundBoards, fit: StereoFit) -> None:
    """Print the outcome of each view to stderr."""
    by_one = 0
    for view, error in zip(found.views, fit.views, strict=True):
        if not error.used:
            typer.echo(f"rejected view {error.name}: {error.reason}", err=True)
            continue
        if view.left is None or view.right is None:
            by_one += 1
            missing = "left" if view.left is None else "right"
            typer.echo(
                f"view {error.name}: not found in the {missing} image, used for the other camera "
                "only",
                err=True,
            )
        if error.strays:
            typer.echo(
                f"view {error.name}: {error.strays} wrongly detected "
                f"corner{'' if error.strays == 1 else 's'} excluded",
                err=True,
            )
    alone = f" and {by_one} single images" if by_one else ""
    typer.echo(f"used {fit.pairs} pairs{alone} of {len(fit.views)} views", err=True)


def _words(fit: StereoFit, verdict: CalibrationVerdict) -> list[str]:
    from observer.calibration.verdict import length_words

    c, half = fit.calibration, fit.interval_95
    across, down = fit.field_of_view_deg
    lines = [
        f"reprojection    {fit.rms_left:.2f} px left, {fit.rms_right:.2f} px right, "
        f"{fit.rms_stereo:.2f} px both (RMS)",
        "epipolar error  "
        + (
            "not measured: too few pairs to hold some out"
            if fit.held_out is None
            else f"{fit.held_out.median_px:.2f} px median, {fit.held_out.p95_px:.2f} px at most "
            f"for 95 % of {fit.held_out.count} corners of held-out views"
        ),
        f"baseline        {1e3 * c.baseline:.1f} ± {1e3 * half.baseline_m:.2f} mm (95 % interval)",
        f"focal length    {c.K1[0, 0]:.1f} ± {half.focal_left_px:.1f} px left, {c.K2[0, 0]:.1f} ± "
        f"{half.focal_right_px:.1f} px right (95 % intervals)",
        f"field of view   {across:.1f} x {down:.1f} degrees",
        "",
        verdict.sentence,
        "",
        f"{'range':>5}  {'depth, 95 %':>18}  {'slowest sideways':>22}  {'slowest towards you':>22}",
    ]
    for row in verdict.rows:
        motions = (
            "none within 1 s" if m is None else f"{m.speed_mps:g} m/s in {m.delay_s:.1f} s"
            for m in (row.across, row.towards)
        )
        depth = f"± {length_words(half_95(row.depth_m))} ({100 * half_95(row.depth_share):.1f} %)"
        lines.append(
            f"{row.distance_m:>3g} m  {depth:>18}  " + "  ".join(f"{m:>22}" for m in motions)
        )
    return [*lines, *(f"warning: {text}" for text in verdict.warnings)]
