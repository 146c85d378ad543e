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
    f, B = camera.fx, camera.baseline
    mid, focal = np.array([camera.cx, camera.cy]), np.array([camera.fx, camera.fy])
    before, now = (((px - mid) / focal).T for px in (seen.before_px, seen.now_px))
    d_before, d_now = seen.before_disparity / f, seen.now_disparity / f
    g_before, g_now = (1 + (m[0] - d) ** 2 for m, d in ((before, d_before), (now, d_now)))
    rays = np.concatenate([before, np.ones((1, before.shape[1]))])
    R, t = seen.T_now_before.rotation, np.array(seen.T_now_before.translation)
    theta = np.array(start, dtype=np.float64)
    sigma = TYPICAL_SIGMA_PX / f
    size = rays.shape[1]
    if size < _LEAST_POINTS or not np.linalg.norm(t) > 0:
        return None
    J = np.zeros((3, size, 8))
    for _ in range(_STEPS):
        p = R @ rays
        rho = (d_before + g_before * theta[0]) / B
        q = p + t[:, None] * rho
        w = 1 / q[2]
        x, y, depth = q[0] * w, q[1] * w, rho * w
        residual = np.stack([now[0] - x, now[1] - y, d_now + g_now * theta[0] - B * depth])
        # Derivative of the second view's prediction by the first one's disparity.
        lever = np.stack([(t[0] - x * t[2]) * w, (t[1] - y * t[2]) * w, w - depth * w * t[2]])
        lever[:2] /= B
        px, py, pz = p * w
        J[0, :, 0], J[0, :, 1], J[0, :, 2] = -x * py, pz + x * px, -py
        J[1, :, 0], J[1, :, 1], J[1, :, 2] = -pz - y * py, y * px, px
        J[0, :, 3] = J[1, :, 4] = depth
        J[0, :, 5], J[1, :, 5] = -x * depth, -y * depth
        J[2, :, 0], J[2, :, 1], J[2, :, 5] = -B * depth * py, B * depth * px, -B * depth**2
        J[:, :, 6] = lever * g_before
        J[2, :, 6] -= g_now
        J[:, :, 7] = 0.0
        noise = sigma * np.sqrt(1 + lever**2)
        length = np.sqrt(((residual / noise) ** 2).mean(axis=0))
        spread = max(1.0, MAD_TO_SIGMA * median(length))
        fits = tukey_weights(length, spread)
        if np.count_nonzero(fits) < _LEAST_POINTS:
            return None
        weight = (fits / (spread * noise) ** 2).ravel()
        rows = J.reshape(-1, 8)
        weighted = rows * weight[:, None]
        H, b = weighted.T @ rows, weighted.T @ residual.ravel()
        if seen.distance_m is not None:
            fitted_m = float(np.linalg.norm(t))
            row = np.concatenate([np.zeros(3), t / fitted_m, [0.0, -seen.distance_m]])
            row /= seen.distance_std_m
            H += np.outer(row, row)
            b += row * (seen.distance_m * (1 + theta[1]) - fitted_m) / seen.distance_std_m
        held, pull = H.copy(), b.copy()
        held[7, 7] += scale_sigma**-2
        pull[7] -= theta[1] * scale_sigma**-2
        # If all points are equally far, only the prior determines v and s.
        step = np.linalg.solve(held + 1e-9 * np.diag(np.diag(held)), pull)
        at, before_step = theta, (H, b)
        R, t, theta = rotation_matrix(step[:3]) @ R, t + step[3:6], theta + step[6:]
    H, b = before_step
    gain = np.linalg.solve(H[:6, :6], H[:6, 6:]).T
    information = H[6:, 6:] - gain @ H[:6, 6:]
    information = (information + information.T) / 2
    vector = b[6:] - gain @ b[:6] + information @ at
    own = np.linalg.pinv(information, rcond=1e-6, hermitian=True) @ vector
    if not np.isfinite(own).all():
        return None
    return DistanceEquation(information, vector, float(own @ vector))
