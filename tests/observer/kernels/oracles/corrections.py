"""Oracle of ``observer.kernels.corrections``: the same for all cells at once, by numpy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.methods.rigid.dense.grid import Grid
from observer.vision.disparity_bias import bias_profile


def with_bias(disparity: NDArray[np.float32], bias_px: float, grid: Grid) -> NDArray[np.float32]:
    """(h, w) px: disparities plus a bias that is given at the image's centre."""
    rows, columns = np.indices(grid.shape, np.float64)
    px = grid.to_px(np.stack([columns, rows], axis=-1)).reshape(-1, 2)
    profile = bias_profile(px, disparity.ravel().astype(np.float64), grid.camera)
    return (disparity + bias_px * profile.reshape(grid.shape)).astype(np.float32)
