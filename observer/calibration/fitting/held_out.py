"""Cross-validation of a calibration on views that it was not fitted to.

The views of a pair are split into folds. For each fold the model is fitted without it, starting
from the full solution, and tested on it. A rectified pair must show a point in the same row of both
images: this vertical error needs no pose of the board and no ground truth. The final calibration
uses all views, so it is a little better than reported here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from observer.calibration.fitting.adjustment import Corners, StereoModel, adjust
from observer.calibration.fitting.uncertainty import rectified_directions
from observer.camera import StereoCalibration
from observer.errors import CalibrationError
from observer.geometry import Float64Array

FOLDS = 6
# Without one fold, enough views must be left for a fit.
FEWEST_HELD_OUT = 6
_STEPS = 4
_POSE_STEPS = 8


@dataclass(frozen=True)
class HeldOut:
    """Vertical error after rectification, on views that the fit did not see.

    Attributes:
        median_px, p95_px: of its absolute value, pixels of the left image as taken.
        lasting_px: the part of it that all corners of a view have in common (root mean square
            over the views, less the contribution of noise): an error of the calibration that
            persists while an object stays where it is.
        count: corners. folds: number of folds.
    """

    median_px: float
    p95_px: float
    lasting_px: float
    count: int
    folds: int


# Rigs, each fitted without one fold, and the views (V,) of that fold.
Folds: TypeAlias = list[tuple[StereoModel, NDArray[np.bool_]]]


def fit_folds(
    model: StereoModel,
    corners: tuple[Corners, Corners],
    both: NDArray[np.bool_],
    soft_px: float,
    report: Callable[[float], None] = lambda _: None,
) -> Folds | None:
    """Fit once without each fold of the views in ``both`` (V,); None if there are too few.

    Args:
        report: called with the share done, from 0 to 1.
    """
    shown = np.flatnonzero(both)
    if len(shown) < FEWEST_HELD_OUT:
        return None
    folds: Folds = []
    count = min(FOLDS, len(shown))
    for fold in range(count):
        part = np.zeros(len(both), np.bool_)
        part[shown[fold::count]] = True
        kept = [each.of_views(~part) for each in corners]
        folds.append((adjust(model, kept, soft_px=soft_px, iterations=_STEPS).model, part))
        report((fold + 1) / count)
    return folds


def reprojection(folds: Folds, corners: tuple[Corners, Corners], soft_px: float) -> Float64Array:
    """(V,) mean square reprojection error, px^2, of held-out views; NaN for others.

    Only the pose of the board is fitted to them.
    """
    out = np.full(len(folds[0][1]), np.nan)
    for model, part in folds:
        left_out = [each.of_views(part) for each in corners]
        found = adjust(model, left_out, soft_px=soft_px, iterations=_POSE_STEPS, hold=True)
        view = np.concatenate([each.view for each in left_out])
        square = np.sum(np.concatenate(found.residuals) ** 2, axis=1)
        # Limit the influence of a single wrong corner.
        square = np.minimum(square, (3 * soft_px) ** 2)
        for index in np.flatnonzero(part):
            out[index] = float(square[view == index].mean())
    return out


def richer_is_better(simple: Float64Array, rich: Float64Array) -> bool:
    """Return whether further distortion terms make held-out views (V,) clearly better.

    Clearly: by more than one standard error of the gain, as a term without support in the data
    bends the image where no board was seen.
    """
    gain = (simple - rich)[np.isfinite(simple) & np.isfinite(rich)]
    if len(gain) < 2:
        return False
    return bool(gain.mean() > gain.std(ddof=1) / np.sqrt(len(gain)))


def held_out(folds: Folds, corners: tuple[Corners, Corners]) -> HeldOut | None:
    """Return the vertical errors of all held-out views; None where there are none."""
    errors: list[Float64Array] = []
    for model, part in folds:
        try:
            calibration = model.calibration
        except CalibrationError:
            return None
        left, right = (each.of_views(part) for each in corners)
        for view in np.flatnonzero(part):
            pair = common_px(left, right, int(view))
            error = vertical_errors(calibration, *pair)
            errors.append(error[np.isfinite(error)])
    errors = [each for each in errors if len(each)]
    if not errors:
        return None
    every = np.concatenate(errors)
    means = np.array([each.mean() for each in errors])
    noise = np.array([each.var(ddof=min(1, len(each) - 1)) / len(each) for each in errors])
    return HeldOut(
        median_px=float(np.median(np.abs(every))),
        p95_px=float(np.percentile(np.abs(every), 95)),
        lasting_px=float(np.sqrt(max(0.0, float((means**2 - noise).mean())))),
        count=len(every),
        folds=len(folds),
    )


def vertical_errors(
    calibration: StereoCalibration, left_px: Float64Array, right_px: Float64Array
) -> Float64Array:
    """(N,) px, right minus left row after rectification, of pixels (N, 2) as taken.

    In pixels at the left image's own focal length: rectification with alpha 0 zooms, which would
    make cameras with strong distortion seem worse.
    """
    left, right, _ = rectified_directions(calibration, left_px, right_px)
    focal = float(calibration.K1[1, 1])
    return np.asarray(focal * (right[:, 1] - left[:, 1]), dtype=np.float64)


def common_px(left: Corners, right: Corners, view: int) -> tuple[Float64Array, Float64Array]:
    """(N, 2) pixels in each image of the corners of a view that both cameras saw."""
    a, b = left.view == view, right.view == view
    # Corners are identified by their positions on the board.
    same = (left.on_board[a][:, None] == right.on_board[b]).all(axis=2)
    in_left, in_right = np.nonzero(same)
    return left.px[a][in_left], right.px[b][in_right]
