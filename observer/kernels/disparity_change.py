"""Change of all disparities over a frame by a robust fit; see ``DisparityStep``."""

from __future__ import annotations

import math

import numpy as np

from observer.kernels.compiled import (
    CAMERA,
    REAL,
    REALS1,
    REALS2,
    Camera,
    Reals,
    kernel,
    part,
)
from observer.kernels.small import clear, median, solved
from observer.robust import MAD_TO_SIGMA, TUKEY_SIGMAS

_ITERATIONS = 3
_LEAST_SCATTER_PX = 0.05
# Keeps the equations solvable where two of the terms are nearly collinear.
_DAMPING = 1e-9


@part
def _first_of_inverse(factor: Reals) -> float:
    """Return the first entry of the inverse of L L^T, from Cholesky's factor L (4, 4)."""
    column = np.empty(4)
    square = 0.0
    for i in range(4):
        entry = 1.0 if i == 0 else 0.0
        for k in range(i):
            entry -= factor[i, k] * column[k]
        column[i] = entry / factor[i, i]
        square += column[i] * column[i]
    return square


@part
def _robust_first(design: Reals, values: Reals) -> tuple[float, float]:
    """Return the first coefficient of a fit of values (N,) by design (N, 4), and its sigma.

    With Tukey's weights; the sigma is infinite if the values do not determine it.
    """
    count = len(values)
    size, rest = np.zeros(4), np.empty(count)
    for k in range(4):
        for i in range(count):
            size[k] = max(size[k], abs(design[i, k]))
        if not size[k] > 0.0:
            size[k] = 1.0
    residual, weight = np.empty(count), np.ones(count)
    A, b, found = np.empty((4, 4)), np.empty(4), np.zeros(4)
    scatter = _LEAST_SCATTER_PX
    for _ in range(_ITERATIONS):
        clear(A, b)
        for i in range(count):
            for k in range(4):
                weighted = design[i, k] / size[k] * weight[i]
                b[k] += weighted * values[i]
                for m in range(k + 1):
                    A[k, m] += weighted * (design[i, m] / size[m])
        for k in range(4):
            A[k, k] += _DAMPING * count
        if not solved(A, b, found):
            return 0.0, np.inf
        for i in range(count):
            predicted = 0.0
            for k in range(4):
                predicted += found[k] * (design[i, k] / size[k])
            residual[i] = rest[i] = abs(values[i] - predicted)
        scatter = max(_LEAST_SCATTER_PX, MAD_TO_SIGMA * median(rest))
        for i in range(count):
            far = residual[i] / (TUKEY_SIGMAS * scatter)
            weight[i] = max(1.0 - far * far, 0.0) ** 2
    return found[0] / size[0], scatter * math.sqrt(_first_of_inverse(A)) / size[0]


@kernel(REALS2, REALS2, REALS1, REALS1, CAMERA, REAL)
def disparity_change(
    before_px: Reals,
    now_px: Reals,
    before_disparity: Reals,
    now_disparity: Reals,
    camera: Camera,
    least_px: float,
) -> tuple[float, float, Reals]:
    """Fit ``Delta d = c (1 + x^2) + alpha d^2 + beta x d + gamma y d`` to static points.

    Args:
        before_px, now_px: (N, 2) pixels, left image. before_disparity, now_disparity: (N,) pixels,
            NaN unknown.
        camera: fx, fy, cx, cy, pixels, and the baseline, metres.
        least_px: points with disparities not above it are not used.

    Returns:
        c and its standard deviation, pixels, infinite if undetermined, and the flow along the rows
        (M,) of the points used, pixels at the image's centre.
    """
    fx, fy, cx, cy, _ = camera
    count = 0
    for i in range(len(before_disparity)):
        count += before_disparity[i] > least_px and now_disparity[i] > least_px
    design, values, flow = np.empty((count, 4)), np.empty(count), np.empty(count)
    n = 0
    for i in range(len(before_disparity)):
        before, now = before_disparity[i], now_disparity[i]
        if not (before > least_px and now > least_px):
            continue
        x = (before_px[i, 0] + now_px[i, 0] - 2.0 * cx) / (2.0 * fx)
        y = (before_px[i, 1] + now_px[i, 1] - 2.0 * cy) / (2.0 * fy)
        d = (before + now) / 2.0
        widened = 1.0 + x * x
        design[n, 0], design[n, 1], design[n, 2], design[n, 3] = widened, d * d, x * d, y * d
        values[n] = now - before
        flow[n] = (now_px[i, 0] - before_px[i, 0]) / widened
        n += 1
    if count == 0:
        return 0.0, np.inf, flow
    constant, sigma = _robust_first(design, values)
    return constant, sigma, flow
