"""Oracle of ``observer.kernels.patches``: the same by numpy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array


def describe_patches(
    labels: NDArray[np.int32],
    stats: NDArray[np.int32],
    middles: Float64Array,
    disparity: NDArray[np.float32],
) -> tuple[Float64Array, NDArray[np.int64]]:
    """Median disparity (L,) of each patch, and row and column (L, 2) in its middle."""
    typical, nearest = np.zeros(len(stats)), np.zeros((len(stats), 2), np.int64)
    for label in range(1, len(stats)):
        rows, columns = np.nonzero(labels == label)
        typical[label] = np.median(disparity[rows, columns].astype(np.float64))
        across, down = columns - middles[label, 0], rows - middles[label, 1]
        at = int(np.argmin(across**2 + down**2))
        nearest[label] = rows[at], columns[at]
    return typical, nearest
