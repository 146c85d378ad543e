"""Measurements of tracked points: flow, disparity, noise, and position in the world."""

from __future__ import annotations

import math

import numpy as np

from observer.kernels.compiled import (
    CAMERA,
    REAL,
    REALS1,
    REALS2,
    SINGLES1,
    SINGLES2,
    WHOLES1,
    Camera,
    Indices,
    Reals,
    Singles,
    kernel,
    part,
)


@kernel(
    WHOLES1, SINGLES2, REALS1, SINGLES1, SINGLES2, SINGLES2, SINGLES2, CAMERA,
    REAL, REAL, REAL, REAL, REAL, REAL, REAL,
)  # fmt: skip
def seen_again(
    at: Indices,
    before_px: Singles,
    before_disparity: Reals,
    expected_disparity: Singles,
    seen_px: Singles,
    right_px: Singles,
    match_sigma: Singles,
    camera: Camera,
    dt: float,
    warp_px: float,
    skew_s: float,
    skew_sigma_s: float,
    bias_px: float,
    most_negative_px: float,
    least_px: float,
) -> tuple[Singles, Singles, Reals, Reals, Reals]:
    """Measure those points (M,) of N that were found again.

    Args:
        at: (M,) indices of the points.
        before_px: (N, 2) and before_disparity: (N,) pixels, at the last frame.
        expected_disparity: (N,) pixels, of this one; NaN unknown.
        seen_px, right_px: (N, 2) pixels now, in both images; NaN unknown.
        match_sigma: (N, 2) pixels, one standard deviation in the left and the right image.
        camera: fx, fy, cx, cy, pixels, and the baseline, metres.
        dt: seconds of the frame. warp_px: noise of a patch per relative change of its size.
        skew_s: by which the right camera exposes later; NaN = unknown, which leaves disparities
            as matched. skew_sigma_s: one standard deviation of it.
        bias_px: to be added to all disparities, at the image's centre.
        most_negative_px: disparities not above it are unknown. least_px: the least one returned.

    Returns:
        Pixels (M, 2) in the left and in the right image, flow (M, 2) px/s, disparity (M,) px, NaN
        unknown, and standard deviations (M, 3) px of u, v and disparity.
    """
    fx, _, cx, _, _ = camera
    count = len(at)
    px, right = np.empty((count, 2), np.float32), np.empty((count, 2), np.float32)
    flow, disparity = np.empty((count, 2)), np.empty(count)
    sigma = np.empty((count, 3))
    told = not math.isnan(skew_s)
    for k in range(count):
        i = at[k]
        for axis in range(2):
            px[k, axis], right[k, axis] = seen_px[i, axis], right_px[i, axis]
            flow[k, axis] = float(seen_px[i, axis] - before_px[i, axis]) / dt
        growth = abs(expected_disparity[i] / before_disparity[i] - 1.0)
        warp = 0.0 if math.isnan(growth) else warp_px * growth
        sigma[k, 0] = sigma[k, 1] = math.sqrt(np.float64(match_sigma[i, 0]) ** 2 + warp * warp)
        d = float(px[k, 0] - right[k, 0])
        variance = np.float64(match_sigma[i, 1]) ** 2
        if told:
            # A point with image motion has moved on by the time the right camera exposes.
            d += flow[k, 0] * skew_s
            variance += (flow[k, 0] * skew_sigma_s) ** 2
        if bias_px != 0.0:
            x = (float(px[k, 0]) - d - cx) / fx
            d += bias_px * (1.0 + x * x)
        sigma[k, 2] = math.sqrt(variance)
        disparity[k] = max(d, least_px) if d > most_negative_px else np.nan
    return px, right, flow, disparity, sigma


@part
def _information(
    x: float, y: float, z: float, sigma: Reals, i: int, R: Reals, camera: Camera, out: Reals
) -> bool:
    """Write R J^T S^-1 J R^T (3, 3) of a place in front of the camera; return whether it is finite.

    J is the derivative of u, v and disparity by the place, and S are their variances.
    """
    fx, fy, _, _, baseline = camera
    if not z > 0.0:
        return False
    w = 1.0 / z
    a, b, c = 1.0 / sigma[i, 0], 1.0 / sigma[i, 1], 1.0 / sigma[i, 2]
    # Rows (fu, 0, gu), (0, fv, gv) and (0, 0, gd).
    fu, gu = fx * w * a, -fx * x * w * w * a
    fv, gv = fy * w * b, -fy * y * w * w * b
    gd = -fx * baseline * w * w * c
    # Each row in the world's axes.
    J = np.empty((3, 3))
    for k in range(3):
        J[0, k] = R[k, 0] * fu + R[k, 2] * gu
        J[1, k] = R[k, 1] * fv + R[k, 2] * gv
        J[2, k] = R[k, 2] * gd
    finite = True
    for k in range(3):
        for m in range(k + 1):
            entry = J[0, k] * J[0, m] + J[1, k] * J[1, m] + J[2, k] * J[2, m]
            out[k, m] = out[m, k] = entry
            finite = finite and math.isfinite(entry)
    return finite


@kernel(SINGLES2, REALS1, REALS2, REALS2, REALS2, REALS1, CAMERA)
def placed_in_world(
    px: Singles,
    disparity: Reals,
    sigma: Reals,
    believed: Reals,
    rotation: Reals,
    translation: Reals,
    camera: Camera,
) -> tuple[Reals, Reals]:
    """Place N points, seen in one pair of images, in the world.

    Args:
        px: (N, 2) and disparity: (N,) pixels, NaN unknown. sigma: (N, 3) px, of u, v, disparity.
        believed: (N, 3) metres, world, best estimate of their positions so far; NaN unknown.
        rotation: (3, 3) and translation: (3,) metres, of T_world_camera.
        camera: fx, fy, cx, cy, pixels, and the baseline, metres.

    Returns:
        Positions (N, 3) metres, world, NaN unknown, and their information (N, 3, 3) 1/m^2, world,
        zero where the position is unknown.
    """
    fx, fy, cx, cy, baseline = camera
    R = rotation
    count = len(px)
    position, information = np.empty((count, 3)), np.empty((count, 3, 3))
    one, p, q = np.zeros((3, 3)), np.zeros(3), np.empty(3)
    for i in range(count):
        d = disparity[i]
        known = d > 0.0
        if known:
            p[2] = fx * baseline / d
            p[0] = (float(px[i, 0]) - cx) / fx * p[2]
            p[1] = (float(px[i, 1]) - cy) / fy * p[2]
            # The information depends on the depth, so it is taken at the believed one: the noise
            # of this sighting must not influence its weight.
            for k in range(3):
                q[k] = 0.0
                for m in range(3):
                    q[k] += R[m, k] * (believed[i, m] - translation[m])
            if not (math.isfinite(q[0] + q[1] + q[2]) and q[2] > 0.0):
                q[0], q[1], q[2] = p[0], p[1], p[2]
            known = math.isfinite(p[0] + p[1] + p[2])
            known = known and _information(q[0], q[1], q[2], sigma, i, R, camera, one)
        for k in range(3):
            at = R[k, 0] * p[0] + R[k, 1] * p[1] + R[k, 2] * p[2] + translation[k]
            position[i, k] = at if known else np.nan
            for m in range(3):
                information[i, k, m] = one[k, m] if known else 0.0
    return position, information
