"""Oracle of ``observer.kernels.pose_fit``: the same formulas for all points at once, by numpy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.parameters import EgoMotionParameters

from .pose_ransac import ransac
from .pose_residuals import Linearised, SeenPoints, linearised

# Keeps the equations solvable where the points leave a direction open.
_DAMPING = 1e-9
_STEPS = 4
# The refinement ends when a step changes the pose by less than this share of its uncertainty.
_CONVERGED = 0.02
_HUBER_SIGMAS = 2.0
# Residuals beyond this many standard deviations are outliers of the refinement.
_OUTLIER_SIGMAS = 3.5


def _gauss_newton(
    linear: Linearised, white: Float64Array, weight: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """The step (6,), rotation vector and translation, and the information (6, 6) of the pose.

    Args:
        white: (3, N) residuals as of ``Linearised.whitened``. weight: (N,) of each point.
    """
    J = linear.jacobian.reshape(6, -1)
    WJ = (linear.jacobian * weight).reshape(6, -1)
    A = WJ @ J.T
    step = np.linalg.solve(_damped(A), WJ @ white.ravel())
    return np.asarray(step, np.float64), A


def _damped(information: Float64Array) -> Float64Array:
    out = information.copy()
    out.flat[::7] += _DAMPING * (1 + np.diagonal(information))
    return out


@dataclass(frozen=True, eq=False)
class Fit:
    """Fit of N points to a pose: whitened residuals (3, N), their lengths (N,), inliers (N,)."""

    white: Float64Array
    mahalanobis: Float64Array
    inliers: NDArray[np.bool_]


def fit_pose(
    points: SeenPoints,
    share: Float64Array,
    expected: Pose,
    camera: StereoCamera,
    parameters: EgoMotionParameters,
    seed: int,
) -> tuple[Pose, Fit, Float64Array]:
    """The pose, how the points fit it, and its information (6, 6)."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return _fitted(points, share, expected, camera, parameters, seed)


def _fitted(
    points: SeenPoints,
    share: Float64Array,
    expected: Pose,
    camera: StereoCamera,
    parameters: EgoMotionParameters,
    seed: int,
) -> tuple[Pose, Fit, Float64Array]:
    linear = linearised(points, expected, camera)
    pose = ransac(points, share, linear, expected, camera, parameters, seed)
    if pose is not expected:
        linear = linearised(points, pose, camera)
    fit = _judged(points, pose, linear, camera, parameters, np.inf)
    information = np.zeros((6, 6))
    for step in range(_STEPS):
        if np.count_nonzero(fit.inliers) < parameters.min_inliers:
            break
        # Huber's weights: points far off that are not outliers count only linearly.
        weight = np.minimum(1.0, _HUBER_SIGMAS / np.maximum(fit.mahalanobis, 1e-9)) * fit.inliers
        change, information = _gauss_newton(linear, fit.white, weight)
        change = np.clip(change, -10.0, 10.0)
        pose = Pose.from_rotvec(change[:3], change[3:]) @ pose
        if step == 0:
            # From here on the pose changes too little to affect the derivatives.
            linear = linearised(points, pose, camera)
        fit = _judged(points, pose, linear, camera, parameters, _OUTLIER_SIGMAS)
        if step and change @ information @ change < _CONVERGED**2:
            break
    return pose, fit, information


def _judged(
    points: SeenPoints,
    pose: Pose,
    linear: Linearised,
    camera: StereoCamera,
    parameters: EgoMotionParameters,
    most_sigmas: float,
) -> Fit:
    """Fit of the points: inliers within the threshold, allowing for each position's covariance."""
    r = points.residuals(pose, camera)
    white = linear.whitened(r)
    squared = (white * white).sum(axis=0)
    squared[~linear.usable] = np.inf
    scaled = r * (linear.sigma[0] / linear.sigma)
    mahalanobis = np.sqrt(squared)
    inliers = (scaled * scaled).sum(axis=0) <= parameters.ransac_threshold_px**2
    inliers &= mahalanobis <= most_sigmas
    return Fit(white, mahalanobis, inliers & linear.usable)
