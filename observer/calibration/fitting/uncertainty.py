"""Uncertainty of a fitted pair of cameras: of its parameters, and of the resulting depth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from observer.calibration.boards.board import Board
from observer.calibration.fitting.adjustment import Adjusted, Corners, StereoModel
from observer.calibration.fitting.lens import directions
from observer.calibration.fitting.model_error import model_shift
from observer.calibration.fitting.view_jackknife import view_covariance
from observer.camera import StereoCalibration
from observer.geometry import Float64Array
from observer.intervals import SIGMAS_95

# Image positions where depth is judged: shares of width and height from the principal point.
_PLACES = ((0.0, 0.0), (-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25))
# Share of a richer model's change that counts as one standard deviation of the error: with it, the
# intervals cover the truth as often as they should.
_SHIFT_SHARE = 0.75


@dataclass(frozen=True)
class Interval95:
    """Half of the 95 % interval of each parameter that people ask for: the ± beside it.

    By ``error_covariance``, as errors in one view are correlated and models are not quite right.

    Attributes:
        focal_left_px, focal_right_px: of fx. centre_left_px, centre_right_px: of cx and cy.
        baseline_m: metres. rotation_deg: of R about the right camera's x, y and z.
        pitch_deg, vergence_deg, roll_deg: of ``view_angles_deg``, which determine depth and rows.
    """

    focal_left_px: float
    focal_right_px: float
    centre_left_px: tuple[float, float]
    centre_right_px: tuple[float, float]
    baseline_m: float
    rotation_deg: tuple[float, float, float]
    pitch_deg: float
    vergence_deg: float
    roll_deg: float


def view_angles_deg(calibration: StereoCalibration) -> Float64Array:
    """(3,) pitch, vergence and roll: the rotation between the views that the two images show.

    Angles between the lines of sight of the two images' centres, down and to the right, and the
    rotation about them. R alone does not give these: a principal point that is off by a few tenths
    of a pixel and a lens that is rotated by hundredths of a degree show the same image, so the fit
    determines each badly and their combination ten times as well.
    """
    c = calibration
    middle = np.array([[(c.width - 1) / 2, (c.height - 1) / 2]])
    left, right = (
        directions(c.distortion_model, K, D, middle)[0] for K, D in ((c.K1, c.D1), (c.K2, c.D2))
    )
    left = c.R @ left
    pitch = np.arctan2(left[1], left[2]) - np.arctan2(right[1], right[2])
    vergence = np.arctan2(left[0], left[2]) - np.arctan2(right[0], right[2])
    roll = np.arctan2(c.R[1, 0] - c.R[0, 1], c.R[0, 0] + c.R[1, 1])
    return np.asarray(np.degrees([pitch, vergence, roll]), dtype=np.float64)


def error_covariance(
    found: Adjusted, corners: Sequence[Corners], board: Board, soft_px: float
) -> Float64Array:
    """Return the covariance (G, G) of the global parameters' errors, as they are in practice.

    It combines the scatter between views with a richer model's change, a bias that all views share.
    ``SIGMAS_95`` standard deviations of it are half of a 95 % interval. Over boards that are tilted
    or not, flat or bent, and noise that corners share, such intervals cover the truth in 90 to
    100 % of all fits; those of ``found.covariance``, by the curvature, in 3 to 72 %.

    Args:
        found: the fit. corners, soft_px: as it was fitted to, see ``adjust``.
    """
    shift = _SHIFT_SHARE * model_shift(found.model, corners, board, soft_px, found.scatter_px)
    scatter = view_covariance(found.model, corners, soft_px)
    return np.asarray(scatter + np.outer(shift, shift), dtype=np.float64)


def interval_95(model: StereoModel, covariance: Float64Array, near: Float64Array) -> Interval95:
    """Return the intervals of a pair by the covariance (G, G) of its global parameters.

    Args:
        near: (G,) changes of the parameters that are small against any curvature.
    """
    half = SIGMAS_95 * np.sqrt(np.diag(covariance))
    each = model.free_count
    along = model.T / np.linalg.norm(model.T)
    T_cov = covariance[-3:, -3:]
    turn = np.rad2deg(half[-6:-3])

    def angles(change: Float64Array) -> Float64Array:
        return view_angles_deg(model.changed(change).calibration)

    J = numeric_jacobian(angles, np.zeros_like(near), near)
    view = SIGMAS_95 * np.sqrt(np.einsum("ai,ij,aj->a", J, covariance, J))
    return Interval95(
        focal_left_px=float(half[0]),
        focal_right_px=float(half[each]),
        centre_left_px=(float(half[2]), float(half[3])),
        centre_right_px=(float(half[each + 2]), float(half[each + 3])),
        baseline_m=SIGMAS_95 * float(np.sqrt(along @ T_cov @ along)),
        rotation_deg=(float(turn[0]), float(turn[1]), float(turn[2])),
        pitch_deg=float(view[0]),
        vergence_deg=float(view[1]),
        roll_deg=float(view[2]),
    )


def depth_covariance(
    model: StereoModel, covariance: Float64Array, near: Float64Array
) -> Float64Array:
    """Return the covariance of the two causes of depth errors, valid at every distance.

    To first order the relative error of depth Z is ``scale - offset Z / (f B)``: a wrong
    baseline is a share of the depth, a wrong vergence or principal point a wrong disparity, which
    matters more the farther the point is.

    Args:
        covariance: (G, G) of the global parameters. near: (G,) as for ``interval_95``.

    Returns:
        (2, 2) covariance of (scale, offset in pixels), the mean over five places in the image.
    """
    truth = model.calibration

    def changes(change: Float64Array) -> Float64Array:
        return depth_change(truth, model.changed(change).calibration).reshape(-1)

    J = numeric_jacobian(changes, np.zeros_like(near), near)
    J = J.reshape(len(_PLACES), 2, -1)
    parts = np.einsum("pig,gh,pjh->pij", J, covariance, J)
    return np.asarray(parts.mean(axis=0), dtype=np.float64)


def depth_change(truth: StereoCalibration, wrong: StereoCalibration) -> Float64Array:
    """Return the depth error that results when ``wrong`` is used where ``truth`` holds.

    Points of known depth are projected by the one and measured by the other, at two depths; the two
    errors give a relative error of the depth and a constant error of the disparity.

    Returns:
        (P, 2): relative error, and pixels of disparity (as of a focal length of K1), at P places.
    """
    # Far apart in disparity, and both far from any singularity.
    depths = np.array([15.0, 60.0]) * truth.baseline
    errors = np.stack([_relative_error(truth, wrong, depth) for depth in depths])
    # error = scale - offset Z / (f B): a disparity that is too large makes depth too small.
    per_px = depths / truth.fb
    offset = -(errors[1] - errors[0]) / (per_px[1] - per_px[0])
    scale = errors[0] + offset * per_px[0]
    return np.stack([scale, offset], axis=1)


def _relative_error(
    truth: StereoCalibration, wrong: StereoCalibration, depth: float
) -> Float64Array:
    """(P,) relative depth errors of points at this depth, metres."""
    K = truth.K1
    places = np.array(_PLACES) * [truth.width, truth.height]
    u = np.column_stack([places[:, 0] / K[0, 0], places[:, 1] / K[1, 1], np.ones(len(places))])
    points = depth * u
    left = _project(truth.distortion_model, truth.K1, truth.D1, points)
    right = _project(truth.distortion_model, truth.K2, truth.D2, points @ truth.R.T + truth.T)
    seen = intersected(wrong, left, right)
    return np.asarray(seen / depth - 1, dtype=np.float64)


def intersected(
    calibration: StereoCalibration, left_px: Float64Array, right_px: Float64Array
) -> Float64Array:
    """(N,) metres along the left camera's axis where the rays of pixel pairs (N, 2) as taken meet.

    NaN where they do not meet in front of the cameras. In the rectified pair depth is f B / d
    with the disparity d; here it is converted back to the left camera's own axis.
    """
    c = calibration
    left, right, R1 = rectified_directions(c, left_px, right_px)
    shift = left[:, 0] - right[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        z = np.where(shift > 0, c.baseline / shift, np.nan)
    return np.asarray((z[:, None] * left) @ R1[:, 2], dtype=np.float64)


def rectified_directions(
    calibration: StereoCalibration, left_px: Float64Array, right_px: Float64Array
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Directions (N, 3) with z = 1 in the rectified cameras, and R_rectified_left (3, 3)."""
    c = calibration
    # The rotations follow from R and T alone (Bouguet); the lens only sets the zoom, unused here.
    R1, R2, *_ = cv2.stereoRectify(
        c.K1, np.zeros(5), c.K2, np.zeros(5), (c.width, c.height), c.R, c.T.reshape(3, 1)
    )
    turned = []
    for K, D, px, R in ((c.K1, c.D1, left_px, R1), (c.K2, c.D2, right_px, R2)):
        look = directions(c.distortion_model, K, D, px)
        look = look @ np.asarray(R, dtype=np.float64).T
        with np.errstate(divide="ignore", invalid="ignore"):
            turned.append(np.where(look[:, 2:] > 0, look / look[:, 2:], np.nan))
    return turned[0], turned[1], np.asarray(R1, dtype=np.float64)


def _project(model: str, K: Float64Array, D: Float64Array, points: Float64Array) -> Float64Array:
    zero = np.zeros(3)
    module = cv2.fisheye if model == "equidistant" else cv2
    px, _ = module.projectPoints(points.reshape(-1, 1, 3), zero, zero, K, D)
    return np.asarray(px, dtype=np.float64).reshape(-1, 2)


def numeric_jacobian(
    function: Callable[[Float64Array], Float64Array], at: Float64Array, steps: Float64Array
) -> Float64Array:
    """(M, N) derivative of a function (N,) -> (M,), by central differences of steps (N,)."""
    pairs = zip(np.diag(steps), steps, strict=True)
    return np.stack([(function(at + d) - function(at - d)) / (2 * step) for d, step in pairs], 1)
