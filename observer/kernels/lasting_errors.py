"""Apparent motion of points from systematic calibration errors; see ``CameraRate``."""

from __future__ import annotations

import numpy as np

from observer.kernels.compiled import CAMERA, REAL, REALS1, REALS2, Camera, Reals, kernel, part


@part
def lasting_error(
    x: float, y: float, z: float, vx: float, vy: float, vz: float,
    turn: Reals, shift: Reals, camera: Camera, corner2: float, out: Reals,
) -> None:  # fmt: skip
    """Write a point's drift, m/s, per pixel of disparity and per unit distortion, to out (2, 3)."""
    fx, fy, _, _, baseline = camera
    if not z > 0.0:
        for k in range(3):
            out[0, k] = out[1, k] = 0.0
        return
    # The point's motion relative to the camera, by translation (r) and by the camera's turn (t).
    rx, ry, rz = vx + shift[0], vy + shift[1], vz + shift[2]
    tx, ty = turn[1] * z - turn[2] * y, turn[2] * x - turn[0] * z
    tz = turn[0] * y - turn[1] * x
    # Disparity: -b/d (p' + p Z'/Z), 1/d = Z / (f B).
    per_disparity = z / (fx * baseline)
    nearing = (rz + tz) / z
    out[0, 0] = -per_disparity * (rx + x * nearing)
    out[0, 1] = -per_disparity * (ry + y * nearing)
    out[0, 2] = -per_disparity * (rz + z * nearing)
    # Distortion: the error as a share of the flow grows with the fourth power of the distance from
    # the principal point.
    u, v = fx * x / z, fy * y / z
    share = min((u * u + v * v) / corner2, 1.0) ** 2
    out[1, 0] = share * (rx + tx - x / z * (rz + tz))
    out[1, 1] = share * (ry + ty - y / z * (rz + tz))
    out[1, 2] = 0.0


@kernel(REALS2, REALS2, REALS1, REALS1, CAMERA, REAL)
def lasting_errors(
    place: Reals, velocity: Reals, turn: Reals, shift: Reals, camera: Camera, corner2: float
) -> Reals:
    """Return drifts (N, 2, 3) m/s, camera axes: per pixel of disparity, per unit distortion.

    Args:
        place: (N, 3) metres and velocity: (N, 3) m/s, camera frame, the points' own.
        turn: (3,) rad/s and shift: (3,) m/s, of the camera as of ``CameraRate``.
        camera: fx, fy, cx, cy, pixels, and the baseline, metres.
        corner2: px^2, squared distance of the image's farthest corner from the principal point.
    """
    out = np.empty((len(place), 2, 3))
    for i in range(len(place)):
        lasting_error(
            place[i, 0], place[i, 1], place[i, 2], velocity[i, 0], velocity[i, 1], velocity[i, 2],
            turn, shift, camera, corner2, out[i],
        )  # fmt: skip
    return out
