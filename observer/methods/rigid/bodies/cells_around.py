"""The cells at and around a few pixels: to look at these alone costs less than at a whole image."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from observer.methods.rigid.dense.grid import Grid


def cells_around(
    grid: Grid, px: NDArray[np.float32], reach: int
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns (N, K) of the K cells up to so many away from pixels (N, 2), level and down.

    Beyond the border stand those at it.
    """
    (rows, columns), (down, across) = grid.at(px), _square(reach)
    return (
        (rows[:, None] + down).clip(0, grid.height - 1),
        (columns[:, None] + across).clip(0, grid.width - 1),
    )


@cache
def _square(reach: int) -> NDArray[np.intp]:
    """(2, 1, K) rows and columns from the middle of a square to its cells."""
    return np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, 1, -1)
