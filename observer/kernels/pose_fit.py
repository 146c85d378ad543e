"""A camera's pose from points of known places: RANSAC, and least squares on its inliers."""

from __future__ import annotations

import math

import numpy as np

from observer.kernels.compiled import (
    CAMERA,
    REAL,
    REALS1,
    REALS2,
    REALS3,
    WHOLE,
    Camera,
    Flags,
    Reals,
    kernel,
    part,
)
from observer.kernels.pose_ransac import ransac
from observer.kernels.pose_residuals import DAMPING, OUTLIER_SIGMAS, linearise, residual
from observer.kernels.small import clear, copy_pose, solved, turned

_STEPS = 4
# The refinement ends when a step changes the pose by less than this share of its uncertainty.
_CONVERGED = 0.02
_HUBER_SIGMAS = 2.0
_LARGEST_STEP = 10.0


@part
def _judge(
    place: Reals,
    seen: Reals,
    R: Reals,
    t: Reals,
    camera: Camera,
    threshold: float,
    most: float,
    sigma: Reals,
    factor: Reals,
    usable: Flags,
    white: Reals,
    length: Reals,
    inlier: Flags,
) -> int:
    """Write whitened residuals white (N, 3), lengths (N,) and inliers (N,); return their number."""
    r = np.empty(3)
    count = 0
    for i in range(len(place)):
        inlier[i] = False
        length[i] = np.inf
        white[i, 0] = white[i, 1] = white[i, 2] = 0.0
        if not usable[i]:
            continue
        _, _, z = residual(place, seen, R, t, camera, i, r)
        if not z > 0.0:
            continue
        white[i, 0] = r[0] * factor[i, 0]
        white[i, 1] = r[0] * factor[i, 1] + r[1] * factor[i, 2]
        white[i, 2] = r[0] * factor[i, 3] + r[1] * factor[i, 4] + r[2] * factor[i, 5]
        square = white[i, 0] ** 2 + white[i, 1] ** 2 + white[i, 2] ** 2
        length[i] = math.sqrt(square)
        # Within the threshold, with v and disparity scaled to the noise of u.
        b, c = r[1] * sigma[i, 0] / sigma[i, 1], r[2] * sigma[i, 0] / sigma[i, 2]
        inlier[i] = r[0] * r[0] + b * b + c * c <= threshold * threshold and length[i] <= most
        count += inlier[i]
    return count


@part
def _gauss_newton(
    jacobian: Reals,
    white: Reals,
    length: Reals,
    inlier: Flags,
    information: Reals,
    scratch: Reals,
    b: Reals,
    step: Reals,
) -> None:
    """Write the pose's information (6, 6) from the inliers, and the step (6,) to its best value."""
    clear(information, b)
    for i in range(len(inlier)):
        if not inlier[i]:
            continue
        # Huber's weight: large residuals that are not outliers count linearly.
        w = min(1.0, _HUBER_SIGMAS / max(length[i], 1e-9))
        for row in range(3):
            for k in range(6):
                weighted = jacobian[i, row, k] * w
                b[k] += weighted * white[i, row]
                for m in range(k + 1):
                    information[k, m] += weighted * jacobian[i, row, m]
    for k in range(6):
        for m in range(k):
            information[m, k] = information[k, m]
    for k in range(6):
        for m in range(k + 1):
            scratch[k, m] = information[k, m]
        scratch[k, k] += DAMPING * (1.0 + information[k, k])
    solved(scratch, b, step)
    for k in range(6):
        step[k] = min(max(step[k], -_LARGEST_STEP), _LARGEST_STEP)


@part
def _squared(step: Reals, information: Reals) -> float:
    """Return the squared size of a step (6,) in standard deviations of the pose."""
    total = 0.0
    for k in range(6):
        for m in range(6):
            total += step[k] * information[k, m] * step[m]
    return total


@kernel(
    REALS2, REALS3, REALS2, REALS2, REALS1, REALS2, REALS1, CAMERA, REAL, WHOLE, WHOLE, REALS2
)  # fmt: skip
def fit_pose(
    place: Reals,
    covariance: Reals,
    seen: Reals,
    variance: Reals,
    share: Reals,
    rotation: Reals,
    translation: Reals,
    camera: Camera,
    threshold: float,
    min_inliers: int,
    iterations: int,
    chances: Reals,
) -> tuple[Reals, Reals, Reals, Flags, Reals]:
    """Find the pose T_camera_world that best explains where N points are seen.

    Args:
        place: (N, 3) metres, world. covariance: (N, 3, 3) m^2, of it.
        seen: (N, 3) pixels, u, v and disparity, NaN where it is unknown. variance: (N, 3) px^2.
        share: (N,) of the image that each point represents.
        rotation: (3, 3) and translation: (3,) metres, of the expected pose.
        camera: fx, fy, cx, cy, pixels, and the baseline, metres.
        threshold: pixels, for inliers.
        iterations: most samples of RANSAC. chances: (M, 3) random numbers from 0 to 1 for them.

    Returns:
        Rotation (3, 3), translation (3,), lengths (N,) of the residuals in standard deviations,
        which are inliers (N,), and the information (6, 6) of rotation and translation.
    """
    count = len(place)
    R, t = np.empty((3, 3)), np.empty(3)
    copy_pose(rotation, translation, R, t)
    sigma, factor = np.empty((count, 3)), np.empty((count, 6))
    jacobian, usable = np.empty((count, 3, 6)), np.empty(count, np.bool_)
    white, length, inlier = np.empty((count, 3)), np.empty(count), np.empty(count, np.bool_)
    linearise(place, covariance, seen, variance, R, t, camera, sigma, factor, jacobian, usable)
    ransac(place, seen, variance, share, sigma, R, t, camera, threshold, iterations, chances)
    linearise(place, covariance, seen, variance, R, t, camera, sigma, factor, jacobian, usable)
    found = _judge(
        place, seen, R, t, camera, threshold, np.inf, sigma, factor, usable, white, length, inlier
    )
    information, scratch = np.zeros((6, 6)), np.empty((6, 6))
    b, step = np.empty(6), np.empty(6)
    for turn in range(_STEPS):
        if found < min_inliers:
            break
        _gauss_newton(jacobian, white, length, inlier, information, scratch, b, step)
        turned(step, R, t)
        if turn == 0:
            # Only once: from here on the pose changes too little to matter for the derivatives.
            linearise(
                place, covariance, seen, variance, R, t, camera, sigma, factor, jacobian, usable
            )
        found = _judge(
            place, seen, R, t, camera, threshold, OUTLIER_SIGMAS, sigma, factor, usable, white,
            length, inlier,
        )  # fmt: skip
        if turn > 0 and _squared(step, information) < _CONVERGED**2:
            break
    return R, t, length, inlier, information
