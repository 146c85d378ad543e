"""The cells at and around a few pixels, which cost less to look at than a whole image."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from observer.methods.rigid.dense.grid import Grid


def cells_around(
    grid: Grid, px: NDArray[np.float32], reach: int
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return rows and columns (N, K) of the square of K cells around each pixel (N, 2).

    Cells beyond the border are replaced by those at it.

    Args:
        reach: cells from the middle of a square to its sides.
    """
    (rows, columns), (down, across) = grid.at(px), _square(reach)
    return (
        (rows[:, None] + down).clip(0, grid.height - 1),
        (columns[:, None] + across).clip(0, grid.width - 1),
    )


@cache
def _square(reach: int) -> NDArray[np.intp]:
    """(2, 1, K) row and column offsets of a square's cells from its middle."""
    return np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, 1, -1)
