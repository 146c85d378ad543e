"""Single places in a stereo camera's view, and their covariances."""

from __future__ import annotations

import math

import numpy as np

from observer.kernels.compiled import CAMERA, REAL, REALS1, REALS2, Camera, Reals, kernel


def place_of(u: float, v: float, disparity: float, R: Reals, t: Reals, camera: Camera) -> Reals:
    """Return the place (3,) m, world, of a point seen at a pixel with a disparity, px.

    Args:
        R: (3, 3) and t: (3,) metres of ``T_world_camera``.
    """
    return sighting(u, v, disparity, 0.0, 0.0, 0.0, R, t, camera)[0]


@kernel(REALS1, REALS2, REALS1, CAMERA)
def view_of(place: Reals, R: Reals, t: Reals, camera: Camera) -> tuple[float, float, float]:
    """Return u, v and disparity, px, of a place (3,) m, world; NaN if not in front of the camera.

    Args:
        R: (3, 3) and t: (3,) metres of ``T_camera_world``.
    """
    fx, fy, cx, cy, baseline = camera
    x = R[0, 0] * place[0] + R[0, 1] * place[1] + R[0, 2] * place[2] + t[0]
    y = R[1, 0] * place[0] + R[1, 1] * place[1] + R[1, 2] * place[2] + t[1]
    z = R[2, 0] * place[0] + R[2, 1] * place[1] + R[2, 2] * place[2] + t[2]
    if not z > 0.0:
        return np.nan, np.nan, np.nan
    return fx * x / z + cx, fy * y / z + cy, fx * baseline / z


@kernel(REAL, REAL, REAL, REAL, REAL, REAL, REALS2, REALS1, CAMERA)
def sighting(
    u: float, v: float, disparity: float, across: float, down: float, along: float,
    R: Reals, t: Reals, camera: Camera,
) -> tuple[Reals, Reals]:  # fmt: skip
    """Return the place (3,) m, world, of a point seen at a pixel, and its covariance (3, 3).

    Args:
        disparity: px. across, down, along: m, standard deviations horizontally across the line of
            sight, downwards across it, and along it. R: (3, 3) and t: (3,) metres of
            ``T_world_camera``.
    """
    fx, fy, cx, cy, baseline = camera
    z = fx * baseline / disparity if disparity > 0.0 else np.nan
    x, y = (u - cx) / fx * z, (v - cy) / fy * z
    place, axes = np.empty(3), np.empty((3, 3))
    for i in range(3):
        place[i] = R[i, 0] * x + R[i, 1] * y + R[i, 2] * z + t[i]
    # Columns in the camera's frame: across, down = ray x across, and the ray, each times its sigma.
    length, level = math.sqrt(x * x + y * y + z * z), math.sqrt(x * x + z * z)
    c, s = z / level, -x / level
    x, y, z = x / length, y / length, z / length
    axes[0, 0], axes[1, 0], axes[2, 0] = c * across, 0.0, s * across
    axes[0, 1], axes[1, 1], axes[2, 1] = y * s * down, (z * c - x * s) * down, -y * c * down
    axes[0, 2], axes[1, 2], axes[2, 2] = x * along, y * along, z * along
    spread, covariance = np.empty((3, 3)), np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            spread[i, j] = R[i, 0] * axes[0, j] + R[i, 1] * axes[1, j] + R[i, 2] * axes[2, j]
    for i in range(3):
        for j in range(3):
            covariance[i, j] = (
                spread[i, 0] * spread[j, 0]
                + spread[i, 1] * spread[j, 1]
                + spread[i, 2] * spread[j, 2]
            )
    return place, covariance
