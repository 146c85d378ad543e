"""Estimation of the vergence error from two views, with or without a known distance between them.

A vergence error v (radians, the real right camera turned towards the left one beyond what the
calibration says) shifts every point of the right image by ``f g v`` along its row, with
``g = 1 + x_r^2`` and x_r the point's ``(u_r - c_x) / f``; all disparities are too small by it. With
the true disparity ``d = d_seen + f g v`` the inverse depth of a point m = (x, y, 1) is
``rho = d / (f B)``, and after the camera's motion (R, t) it is seen at ``q = R m + t rho``,
``x' = q_x / q_z``, ``y' = q_y / q_z``, ``d'_seen = f B rho / q_z - f g' v``.

If t is estimated from the images with v = 0, each point implies a true distance of ``d / d_seen``
times the estimated one: distances seem longer or shorter by the factor ``1 - f v <g / d>``, with
the mean over the points weighted by their information on the distance, about d^2. So the distance
by wheel odometry determines v, the better the smaller the disparities are: f v is known to
``sigma_wheels d``. And since near and far points imply different distances, the spread of
disparities determines v even if the wheels' scale is unknown. Both follow from one fit of R, t, v
and the wheels' scale; R and t are eliminated. Without odometry, only near against far points
determine v.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose, rotation_matrix
from observer.robust import MAD_TO_SIGMA, median, tukey_weights
from observer.vision.klt_tracking import TYPICAL_SIGMA_PX
from observer.vision.view import StereoRows

_STEPS = 3
_LEAST_POINTS = 30
# Smaller disparities are useless; the method clips them.
_LEAST_DISPARITY_PX = 1.0


@dataclass(frozen=True, eq=False)
class SeenTwice:
    """N static points in two views, and the motion between them.

    Attributes:
        before_px, now_px: (N, 2) pixels, rectified left image.
        before_disparity, now_disparity: (N,) pixels.
        T_now_before: the camera's motion from the images; where the fit starts.
        distance_m: distance the camera moved by wheel odometry, metres; None without odometry.
        distance_std_m: one standard deviation of it beyond the wheels' scale.
    """

    before_px: Float64Array
    before_disparity: Float64Array
    now_px: Float64Array
    now_disparity: Float64Array
    T_now_before: Pose
    distance_m: float | None = None
    distance_std_m: float = 0.0

    @staticmethod
    def of(
        before: StereoRows,
        now: StereoRows,
        T_now_before: Pose,
        distance_m: float | None = None,
        distance_std_m: float = 0.0,
    ) -> SeenTwice:
        """Match the points of two views by their numbers.

        Moving points are left to the fit's robust weights: the method's inliers cannot be used,
        as they are the points that fit the possibly wrong calibration.
        """
        at_a, at_b = (
            np.flatnonzero(rows.disparity > _LEAST_DISPARITY_PX) for rows in (before, now)
        )
        _, in_a, in_b = np.intersect1d(
            before.number[at_a], now.number[at_b], assume_unique=True, return_indices=True
        )
        at_a, at_b = at_a[in_a], at_b[in_b]
        return SeenTwice(
            before_px=before.px[at_a],
            before_disparity=before.disparity[at_a],
            now_px=now.px[at_b],
            now_disparity=now.disparity[at_b],
            T_now_before=T_now_before,
            distance_m=distance_m,
            distance_std_m=distance_std_m,
        )


@dataclass(frozen=True, eq=False)
class DistanceEquation:
    """``information @ (v, s) = vector``: vergence v, rad, and the wheels' scale error s, a share.

    The true distance is 1 + s times that of the odometry.

    Attributes:
        information: (2, 2). vector: (2,). square: ``(v, s)^T information (v, s)`` of the pair's
            own best v and s, for checking several pairs against each other.
    """

    information: Float64Array
    vector: Float64Array
    square: float


def distance_equation(
    seen: SeenTwice, camera: StereoCamera, start: tuple[float, float], scale_sigma: float
) -> DistanceEquation | None:
    """Fit motion, vergence and scale by Gauss-Newton, then eliminate the motion.

    Args:
        start: v and s where the fit starts. scale_sigma: prior of s; it only stabilises the fit
            and is not part of the result, as all pairs of a robot share it. Without
            ``distance_m``, s is undetermined.

    Returns:
        The equation; None if too few points fit one motion.
    """
    views = _views(seen, camera)
    R, t = seen.T_now_before.rotation, np.array(seen.T_now_before.translation)
    theta = np.array(start, dtype=np.float64)
    sigma = TYPICAL_SIGMA_PX / camera.fx
    if views.rays.shape[1] < _LEAST_POINTS or not np.linalg.norm(t) > 0:
        return None
    for _ in range(_STEPS):
        residual, J, lever = _linearised(views, R, t, theta[0])
        weight = _weights(residual, sigma * np.sqrt(1 + lever**2))
        if weight is None:
            return None
        rows = J.reshape(-1, 8)
        weighted = rows * weight[:, None]
        H, b = weighted.T @ rows, weighted.T @ residual.ravel()
        if seen.distance_m is not None:
            _add_distance(H, b, t, theta[1], seen.distance_m, seen.distance_std_m)
        held, pull = H.copy(), b.copy()
        held[7, 7] += scale_sigma**-2
        pull[7] -= theta[1] * scale_sigma**-2
        # If all points are equally far, only the prior determines v and s.
        solved = np.linalg.solve(held + 1e-9 * np.diag(np.diag(held)), pull)
        step = np.asarray(solved, dtype=np.float64)
        at = theta
        R, t, theta = rotation_matrix(step[:3]) @ R, t + step[3:6], theta + step[6:]
    return _without_motion(H, b, at)


@dataclass(frozen=True, eq=False)
class _Views:
    """Two views of N points, in units of the focal lengths.

    Attributes:
        rays: (3, N) in the first view, with z = 1. now: (2, N) in the second one.
        d_before, d_now: (N,) disparities. g_before, g_now: (N,) their g; see the module.
        baseline: metres.
    """

    rays: Float64Array
    now: Float64Array
    d_before: Float64Array
    d_now: Float64Array
    g_before: Float64Array
    g_now: Float64Array
    baseline: float


def _views(seen: SeenTwice, camera: StereoCamera) -> _Views:
    mid, focal = np.array([camera.cx, camera.cy]), np.array([camera.fx, camera.fy])
    before, now = (((px - mid) / focal).T for px in (seen.before_px, seen.now_px))
    d_before, d_now = seen.before_disparity / camera.fx, seen.now_disparity / camera.fx
    g_before, g_now = (1 + (m[0] - d) ** 2 for m, d in ((before, d_before), (now, d_now)))
    rays = np.concatenate([before, np.ones((1, before.shape[1]))])
    return _Views(rays, now, d_before, d_now, g_before, g_now, camera.baseline)


def _linearised(
    views: _Views, R: Float64Array, t: Float64Array, vergence: float
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Predict the second view, x, y and disparity, and differentiate the prediction.

    Args:
        R, t: ``T_now_before``. vergence: rad.

    Returns:
        residual (3, N); J (3, N, 8) by rotation, translation, vergence and scale; and its
        derivative (3, N) by the first view's disparity.
    """
    B = views.baseline
    p = R @ views.rays
    rho = (views.d_before + views.g_before * vergence) / B
    q = p + t[:, None] * rho
    w = 1 / q[2]
    x, y, depth = q[0] * w, q[1] * w, rho * w
    residual = np.stack(
        [views.now[0] - x, views.now[1] - y, views.d_now + views.g_now * vergence - B * depth]
    )
    lever = np.stack([(t[0] - x * t[2]) * w, (t[1] - y * t[2]) * w, w - depth * w * t[2]])
    lever[:2] /= B
    px, py, pz = p * w
    J = np.zeros((3, len(rho), 8))
    J[0, :, 0], J[0, :, 1], J[0, :, 2] = -x * py, pz + x * px, -py
    J[1, :, 0], J[1, :, 1], J[1, :, 2] = -pz - y * py, y * px, px
    J[0, :, 3] = J[1, :, 4] = depth
    J[0, :, 5], J[1, :, 5] = -x * depth, -y * depth
    J[2, :, 0], J[2, :, 1], J[2, :, 5] = -B * depth * py, B * depth * px, -B * depth**2
    J[:, :, 6] = lever * views.g_before
    J[2, :, 6] -= views.g_now
    return residual, J, lever


def _weights(residual: Float64Array, noise: Float64Array) -> Float64Array | None:
    """Weights (3 N,) of the residuals (3, N) with this noise (3, N), robust to moving points.

    None if too few points fit one motion.
    """
    length = np.sqrt(((residual / noise) ** 2).mean(axis=0))
    spread = max(1.0, MAD_TO_SIGMA * median(length))
    fits = tukey_weights(length, spread)
    if np.count_nonzero(fits) < _LEAST_POINTS:
        return None
    return np.asarray((fits / (spread * noise) ** 2).ravel(), dtype=np.float64)


def _add_distance(
    H: Float64Array, b: Float64Array, t: Float64Array, scale: float, moved_m: float, std_m: float
) -> None:
    """Add to the normal equations that the wheels moved by ``moved_m`` within ``std_m``."""
    fitted_m = float(np.linalg.norm(t))
    row = np.concatenate([np.zeros(3), t / fitted_m, [0.0, -moved_m]])
    row /= std_m
    H += np.outer(row, row)
    b += row * (moved_m * (1 + scale) - fitted_m) / std_m


def _without_motion(H: Float64Array, b: Float64Array, at: Float64Array) -> DistanceEquation | None:
    """Eliminate R and t from the normal equations at v and s = ``at``; None if they are singular.

    Args:
        H: (8, 8). b: (8,).
    """
    gain = np.linalg.solve(H[:6, :6], H[:6, 6:]).T
    information = H[6:, 6:] - gain @ H[:6, 6:]
    information = (information + information.T) / 2
    vector = b[6:] - gain @ b[:6] + information @ at
    own = np.linalg.pinv(information, rcond=1e-6, hermitian=True) @ vector
    if not np.isfinite(own).all():
        return None
    return DistanceEquation(information, vector, float(own @ vector))
