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
    recurrence: np.float32,
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """(N,) px disparities, NaN unknown, and which recur; the arguments are those of the kernel."""
    column, row = _blocks(px, reduction, side, first.shape)
    cost = _costs(first, second, row, column, side, count)
    found = _best(cost, px[:, 0], reduction, uniqueness, least_gap)
    recurs = np.zeros(len(px), np.bool_)
    for n in np.flatnonzero(np.isfinite(found)):
        begin, last = max(column[n] - count, 0), min(column[n] + count, first.shape[1] - side)
        strip = first[row[n] : row[n] + side, begin : last + side].astype(np.int64)
        own = np.lib.stride_tricks.sliding_window_view(strip, (side, side))[0]
        block = strip[:, column[n] - begin : column[n] - begin + side]
        recurs[n] = _recurs(np.abs(own - block).sum(axis=(1, 2)), column[n] - begin, recurrence)
    return found, recurs


def contradicted_by_rows(
    first: NDArray[np.uint8],
    second: NDArray[np.uint8],
    px: NDArray[np.float32],
    held: NDArray[np.float32],
    reduction: int,
    side: int,
    count: int,
    uniqueness: np.float32,
    least_gap: np.float32,
    near_px: np.float32,
) -> NDArray[np.bool_]:
    """(N,) which disparities are contradicted; the arguments are those of the kernel."""
    column, row = _blocks(px, reduction, side, first.shape)
    cost = _costs(first, second, row, column, side, count)
    found = _best(cost, px[:, 0], reduction, uniqueness, least_gap)
    apart = np.abs(reduction * np.arange(count, -1, -1) - held[:, None])
    near = np.where(apart <= near_px, cost, np.iinfo(np.uint16).max)
    least, own = cost.min(axis=1).astype(np.float32), near.min(axis=1).astype(np.float32)
    ambiguous = np.isnan(found) & (own - least >= np.maximum(uniqueness * own, least_gap))
    return (ambiguous | (np.abs(found - held) > near_px)) & np.isfinite(held)


def least_differences(
    first: NDArray[np.uint8],
    second: NDArray[np.uint8],
    cells: NDArray[np.int64],
    lowest: NDArray[np.int64],
    highest: NDArray[np.int64],
    side: int,
) -> NDArray[np.float64]:
    """(N,) least mean differences, infinite where unknown; the arguments are the kernel's."""
    half, least = side // 2, np.full(len(cells), np.inf)

    def block(image: NDArray[np.uint8], column: int, row: int) -> NDArray[np.int64] | None:
        found = image[
            max(row - half, 0) : row + half + 1, max(column - half, 0) : column + half + 1
        ]
        inside = row >= half and column >= half and found.shape == (side, side)
        return found.astype(np.int64) if inside else None

    for n, (column, row) in enumerate(cells.tolist()):
        own = block(first, column, row)
        others = [block(second, column - d, row) for d in range(lowest[n], highest[n] + 1)]
        apart = [
            np.abs(own - other).mean() for other in others if own is not None and other is not None
        ]
        least[n] = min(apart, default=np.inf)
    return least


def _blocks(
    px: NDArray[np.float32], reduction: int, side: int, shape: tuple[int, ...]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """(N,) columns and rows at which the blocks around pixels (N, 2) begin."""
    column = np.rint(px[:, 0] / reduction).astype(np.intp)
    row = np.rint(px[:, 1] / reduction).astype(np.intp)
    return np.minimum(column, shape[1] - side), np.minimum(row, shape[0] - side)


def _costs(
    first: NDArray[np.uint8],
    second: NDArray[np.uint8],
    row: NDArray[np.intp],
    column: NDArray[np.intp],
    side: int,
    count: int,
) -> NDArray[np.uint16]:
    """(N, count + 1) SADs of the blocks against those of the second image, left to right."""
    block = _windows(first, row, column, side, side).astype(np.int64)
    # Block d of the strip has the disparity count - d.
    strip = _windows(second, row, column, side, side + count).astype(np.int64)
    return np.stack(
        [np.abs(block - strip[:, :, d : d + side]).sum(axis=(1, 2)) for d in range(count + 1)],
        axis=1,
    ).astype(np.uint16)


def _recurs(cost: NDArray[np.int64], own: int, share: np.float32) -> bool:
    """Return whether costs (K,) within a row have a low local minimum besides that at ``own``."""
    number = np.arange(1, len(cost) - 1)
    minimum = (cost[1:-1] <= cost[:-2]) & (cost[1:-1] <= cost[2:]) & (np.abs(number - own) > 1)
    least = cost[1:-1][minimum].min(initial=np.iinfo(np.uint16).max)
    return bool(np.float32(least) * np.float32(len(cost)) < share * np.float32(cost.sum()))


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
