"""Outlier views: which do not fit the others, by how much, and why, in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.calibration.boards.board import FEWEST_CORNERS, Board
from observer.calibration.fitting.adjustment import Adjusted, Corners, StereoModel, adjust
from observer.calibration.fitting.initialization import with_poses
from observer.geometry import Float64Array

# A view is an outlier if its error exceeds the median by this factor, and by this many pixels: blur
# and distance alone make views differ by a factor of two.
_TIMES = 3.0
_BEYOND_PX = 0.3
# Standard deviations: residuals beyond this count only in proportion to their length.
_SOFT_SIGMAS = 4.0
_LEAST_SOFT_PX = 0.2
# The median length of a 2-D normal vector with standard deviation 1.
_MEDIAN_LENGTH = 1.1774
_STEPS = 20
# A corner further off than this, in units of the soft threshold, is wrong; a view with more than
# this share of them is wrong as a whole.
_STRAY = 1.5
_LEAST_STRAY_PX = 0.6
_STRAY_SHARE = 0.15


@dataclass(frozen=True)
class ViewError:
    """Reprojection error of one view.

    Attributes:
        name: of the view. used: whether the fit uses it. reason: why not, a clause.
        left_px, right_px: root mean square error of its corners; None where not seen or unknown.
            For a view that is not used, with the board's best pose.
        strays: number of single corners left out as wrongly detected.
    """

    name: str
    used: bool
    reason: str | None
    left_px: float | None = None
    right_px: float | None = None
    strays: int = 0


def rms(residuals: Float64Array) -> float:
    """Root mean square length of residuals (N, 2), pixels."""
    return float(np.sqrt(np.mean(np.sum(residuals**2, axis=1))))


def soft_threshold(residuals: Sequence[Float64Array]) -> float:
    """Return the residual length from which on they are outliers, pixels, by their median."""
    length = np.linalg.norm(np.concatenate(residuals), axis=1)
    return max(_LEAST_SOFT_PX, _SOFT_SIGMAS / _MEDIAN_LENGTH * float(np.median(length)))


def view_errors(
    residuals: Sequence[Float64Array], corners: Sequence[Corners], views: int
) -> Float64Array:
    """(V, C) root mean square of each view in each camera, pixels; NaN where not seen."""
    pairs = zip(residuals, corners, strict=True)
    return np.stack([np.sqrt(_means(each, seen.view, views)) for each, seen in pairs], axis=1)


def whole_errors(
    residuals: Sequence[Float64Array], corners: Sequence[Corners], views: int
) -> Float64Array:
    """(V,) root mean square over both cameras, pixels; NaN where not seen."""
    view = np.concatenate([each.view for each in corners])
    return np.sqrt(_means(np.concatenate(residuals), view, views))


def limit_px(errors: Float64Array) -> tuple[float, float]:
    """Return the median of errors (V,), ignoring NaN, and the limit above which are outliers."""
    usual = float(np.nanmedian(errors))
    return usual, max(_TIMES * usual, usual + _BEYOND_PX)


def outliers(errors: Float64Array) -> NDArray[np.bool_]:
    """(V,) the worst view and those nearly as bad, if they are outliers; often none.

    Not all outliers at once: a bad view makes others look bad, which are good again without it.
    """
    if np.isnan(errors).all():
        return np.zeros(len(errors), np.bool_)
    _, limit = limit_px(errors)
    worst = float(np.nanmax(errors))
    return np.asarray((errors > limit) & (errors > 0.7 * worst), np.bool_)


def stray_corners(residuals: Float64Array, corners: Corners, soft_px: float) -> NDArray[np.bool_]:
    """(N,) single corners of a camera's views that are wrong in an otherwise good view.

    Beside glare or the image's edge, a corner may be detected a few pixels away.
    """
    far = np.linalg.norm(residuals, axis=1) > max(_LEAST_STRAY_PX, _STRAY * soft_px)
    views = int(corners.view.max(initial=-1)) + 1
    strays = np.bincount(corners.view, far, minlength=views)
    count = np.bincount(corners.view, minlength=views)
    few = (strays <= _STRAY_SHARE * count) & (count - strays >= FEWEST_CORNERS)
    return np.asarray(far & few[corners.view], np.bool_)


def posed(
    model: StereoModel, corners: tuple[Corners, Corners], chosen: NDArray[np.bool_], soft_px: float
) -> tuple[Adjusted, tuple[Corners, Corners]]:
    """Return the chosen views (V,) with the board's best poses for this model, and their corners.

    Where left and right contradict each other, the majority of the corners wins.
    """
    one, two = corners[0].of_views(chosen), corners[1].of_views(chosen)
    model = with_poses(model, 1, two)
    model = with_poses(model, 0, one)
    return adjust(model, (one, two), soft_px=soft_px, iterations=_STEPS, hold=True), (one, two)


def explained(
    model: StereoModel,
    corners: tuple[Corners, Corners],
    index: int,
    name: str,
    usual_px: float,
    soft_px: float,
    board: Board,
) -> ViewError:
    """Return why the view ``index`` does not fit the pair that the others agree on."""
    chosen = np.arange(len(model.board_R)) == index
    found, own = posed(model, corners, chosen, soft_px)
    errors = view_errors(found.residuals, own, len(chosen))[index]
    left, right = (float(e) if np.isfinite(e) else None for e in errors)
    off = float(whole_errors(found.residuals, own, len(chosen))[index])
    apart = f"({off:.1f} px apart, other views {usual_px:.1f} px)"
    turned, _ = posed(model, (own[0], _numbered_back(own[1], board)), chosen, soft_px)
    if rms(np.concatenate(turned.residuals)) < 0.2 * off:
        reason = (
            "its corners are numbered from opposite ends in the two images; a board with an odd "
            "number of corners one way and an even number the other avoids this"
        )
    elif _alone(model, own, chosen, soft_px) < 0.5 * off:
        reason = (
            f"left and right do not show the board in the same pose {apart}: it moved between the "
            "two exposures, or the images do not belong together"
        )
    else:
        reason = (
            f"its corners are off by {off:.1f} px ({usual_px:.1f} px in other views): the board "
            "moved or was detected wrongly"
        )
    return ViewError(name, False, reason, left, right)


def _alone(
    model: StereoModel, own: tuple[Corners, Corners], chosen: NDArray[np.bool_], soft_px: float
) -> float:
    """Return the error of the two images fitted separately, the worse one, pixels."""
    nothing = own[0].of_views(np.zeros_like(chosen))
    worse = 0.0
    for camera, single in enumerate(((own[0], nothing), (nothing, own[1]))):
        if len(own[camera].px):
            found, _ = posed(model, single, chosen, soft_px)
            worse = max(worse, rms(found.residuals[camera]))
    return worse


def _numbered_back(corners: Corners, board: Board) -> Corners:
    """Return the same corners, numbered from the other end of the board."""
    far = board.object_points[-1]
    return Corners(corners.view, far - corners.on_board, corners.px)


def _means(residual: Float64Array, view: NDArray[np.intp], views: int) -> Float64Array:
    count = np.bincount(view, minlength=views)
    total = np.bincount(view, np.sum(residual**2, axis=1), minlength=views)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
