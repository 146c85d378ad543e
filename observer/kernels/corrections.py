"""Bias correction of dense disparities."""

from __future__ import annotations

import numpy as np

from observer.kernels.compiled import CAMERA, REAL, SINGLES2, WHOLE, Camera, Singles, kernel


@kernel(SINGLES2, REAL, CAMERA, WHOLE)
def with_bias(disparity: Singles, bias: float, camera: Camera, reduction: int) -> Singles:
    """Add a bias, px at the image's centre, to disparities (h, w) px, NaN unknown.

    It varies over the image as in ``observer.vision.disparity_bias.bias_profile``.

    Args:
        reduction: pixels per cell.
    """
    fx, _, cx, _, _ = camera
    h, w = disparity.shape
    out = np.empty((h, w), np.float32)
    for r in range(h):
        seen, target = disparity[r], out[r]
        for c in range(w):
            d = float(seen[c])
            # x of the right camera's ray.
            x = ((c + 0.5) * reduction - 0.5 - d - cx) / fx
            target[c] = d + bias * (1.0 + x * x)
    return out
