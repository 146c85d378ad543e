"""Oracle of ``observer.kernels.row_search``: all points at once, by numpy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def search_rows(
    first: NDArray[np.uint8],
    second: NDArray[np.uint8],
    px: NDArray[np.float32],
    reduction: int,
    side: int,
    count: int,
    uniqueness: np.float32,
    least_gap: np.float32,
) -> NDArray[np.float32]:
    """(N,) px disparities, NaN unknown; the arguments are those of the kernel."""
    column = np.rint(px[:, 0] / reduction).astype(np.intp)
    row = np.rint(px[:, 1] / reduction).astype(np.intp)
    column = np.minimum(column, first.shape[1] - side)
    row = np.minimum(row, first.shape[0] - side)
    block = _windows(first, row, column, side, side).astype(np.int64)
    # Block d of the strip has the disparity count - d.
    strip = _windows(second, row, column, side, side + count).astype(np.int64)
    cost = np.stack(
        [np.abs(block - strip[:, :, d : d + side]).sum(axis=(1, 2)) for d in range(count + 1)],
        axis=1,
    )
    return _best(cost.astype(np.uint16), px[:, 0], reduction, uniqueness, least_gap)


def _windows(
    image: NDArray[np.uint8],
    row: NDArray[np.intp],
    column: NDArray[np.intp],
    height: int,
    width: int,
) -> NDArray[np.uint8]:
    """(N, height, width) windows to the right of and below N pixels."""
    return np.lib.stride_tricks.sliding_window_view(image, (height, width))[row, column]


def _best(
    cost: NDArray[np.uint16],
    u: NDArray[np.float32],
    reduction: int,
    uniqueness: np.float32,
    least_gap: np.float32,
) -> NDArray[np.float32]:
    """(N,) px disparity of least cost (N, D), refined by a parabola; NaN if ambiguous or outside.

    Args:
        cost: of the disparities D - 1, ..., 0 in the smaller image.
        u: (N,) px column of each point.
    """
    number, last = np.arange(len(cost)), cost.shape[1] - 1
    best = np.argmin(cost, axis=1)
    least = cost[number, best].astype(np.float32)
    others = cost.copy()
    for offset in (-1, 0, 1):
        others[number, np.clip(best + offset, 0, last)] = np.iinfo(np.uint16).max
    second = others.min(axis=1).astype(np.float32)
    unique = second - least >= np.maximum(uniqueness * second, least_gap)
    before = cost[number, np.maximum(best - 1, 0)].astype(np.float32)
    after = cost[number, np.minimum(best + 1, last)].astype(np.float32)
    bend = np.maximum(before + after - 2 * least, 1)
    between = np.clip((before - after) / (2 * bend), -0.5, 0.5)
    # The first and the last have a neighbour on one side only, hence no parabola.
    between[(best == 0) | (best == last)] = 0
    disparity = reduction * (last - best - between)
    return np.where(unique & (disparity <= u), disparity, np.nan).astype(np.float32)
