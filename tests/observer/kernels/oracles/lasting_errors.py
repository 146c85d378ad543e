"""Oracle of ``observer.kernels.lasting_errors``: the same formulas for all points, by numpy."""

from __future__ import annotations

import numpy as np

from observer.camera import StereoCamera
from observer.geometry import Float64Array, cross_matrix
from observer.vision.camera_rate import CameraRate


def velocity_by_bias(
    rate: CameraRate, place: Float64Array, velocity: Float64Array, camera: StereoCamera
) -> Float64Array:
    """(N, 3) m/s per pixel of disparity."""
    relative = velocity + rate.shift
    depth = place[:, 2]
    seen = depth > 0
    depth = np.where(seen, depth, 1.0)
    depth_rate = relative[:, 2] + rate.turn[0] * place[:, 1] - rate.turn[1] * place[:, 0]
    per_disparity = depth / (camera.fx * camera.baseline)
    drift = -per_disparity[:, None] * (relative + place * (depth_rate / depth)[:, None])
    return np.asarray(drift * seen[:, None], dtype=np.float64)


def velocity_by_distortion(
    rate: CameraRate, place: Float64Array, velocity: Float64Array, camera: StereoCamera
) -> Float64Array:
    """(N, 3) m/s for a stretch of 1."""
    x, y, z = place.T
    seen = z > 0
    z = np.where(seen, z, 1.0)
    relative = velocity + rate.shift + place @ cross_matrix(rate.turn).T
    u, v = camera.fx * x / z, camera.fy * y / z
    width, height = camera.width, camera.height
    corner = np.hypot(max(camera.cx, width - camera.cx), max(camera.cy, height - camera.cy))
    share = np.minimum((u * u + v * v) / corner**2, 1.0) ** 2 * seen
    out = np.zeros_like(place)
    out[:, 0] = share * (relative[:, 0] - x / z * relative[:, 2])
    out[:, 1] = share * (relative[:, 1] - y / z * relative[:, 2])
    return out
