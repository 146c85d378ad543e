"""Oracle of ``observer.kernels.disparity_change``: all points at once, by numpy."""

from __future__ import annotations

import math

import numpy as np

from observer.camera import StereoCamera
from observer.geometry import Float64Array
from observer.robust import MAD_TO_SIGMA, median

_ITERATIONS = 3
_TUKEY_SIGMAS = 4.7
_LEAST_SCATTER_PX = 0.05


def disparity_change(
    before_px: Float64Array,
    now_px: Float64Array,
    before_disparity: Float64Array,
    now_disparity: Float64Array,
    camera: StereoCamera,
    least_px: float,
) -> tuple[float, float, Float64Array]:
    """The constant and its deviation, pixels, and the flow (M,) of the points that determine it."""
    known = (before_disparity > least_px) & (now_disparity > least_px)
    start, end = before_px[known], now_px[known]
    d0, d1 = before_disparity[known], now_disparity[known]
    x = (start[:, 0] + end[:, 0] - 2 * camera.cx) / (2 * camera.fx)
    y = (start[:, 1] + end[:, 1] - 2 * camera.cy) / (2 * camera.fy)
    d, widened = (d0 + d1) / 2, 1 + x * x
    design = np.stack([widened, d * d, x * d, y * d])
    constant, sigma = _robust_first(design, d1 - d0)
    return constant, sigma, (end[:, 0] - start[:, 0]) / widened


def _robust_first(design: Float64Array, values: Float64Array) -> tuple[float, float]:
    """First of the coefficients (4,) by which values (N,) follow (4, N), and its deviation."""
    scaled = design / np.abs(design).max(axis=1, keepdims=True)
    weight = np.ones(len(values))
    inverse, scatter, found = np.eye(4), _LEAST_SCATTER_PX, np.zeros(4)
    for _ in range(_ITERATIONS):
        weighted = scaled * weight
        inverse = np.linalg.inv(weighted @ scaled.T + 1e-9 * len(values) * np.eye(4))
        found = inverse @ (weighted @ values)
        residual = np.abs(values - found @ scaled)
        scatter = max(_LEAST_SCATTER_PX, MAD_TO_SIGMA * median(residual))
        weight = np.clip(1 - (residual / (_TUKEY_SIGMAS * scatter)) ** 2, 0.0, None) ** 2
    size = float(np.abs(design[0]).max())
    return float(found[0]) / size, scatter * math.sqrt(inverse[0, 0]) / size
