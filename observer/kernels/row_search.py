"""Block matching of single points along their row of the other image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.kernels.compiled import (
    BYTES2,
    SINGLE,
    SINGLES1,
    SINGLES2,
    WHOLE,
    WHOLES1,
    WHOLES2,
    Bytes,
    Flags,
    Indices,
    Singles,
    kernel,
    part,
)

_Shorts = NDArray[np.uint16]

_HALF = np.float32(0.5)
_MOST = 65535
# Unsigned indices: numba then need not check for negative ones, which count from the end, and can
# vectorize the sums.
_ONE = np.uint64(1)


@part
def _costs(
    first: Bytes, row: int, column: int, second: Bytes, begin: int, side: int, cost: _Shorts
) -> None:
    """Write to cost (K,) the SADs of a block of the first image against K blocks of the second.

    Args:
        row, column: first row and column of the block. begin: first column of the first of the K
            blocks; each of the others is one column further to the right.
    """
    for k in range(len(cost)):
        cost[k] = 0
    start = np.uint64(begin)
    for i in range(row, row + side):
        at = start
        for j in range(column, column + side):
            grey = first[i, j]
            there = at
            for k in range(len(cost)):
                other = second[i, there]
                apart = np.uint8(max(grey, other) - min(grey, other))
                cost[k] = np.uint16(cost[k] + apart)
                there += _ONE
            at += _ONE


@part
def _least(cost: _Shorts) -> int:
    """Return the number of the least of the costs (K,)."""
    best = 0
    for k in range(1, len(cost)):
        if cost[k] < cost[best]:
            best = k
    return best


@part
def _clearly_less(
    least: np.float32, cost: np.float32, uniqueness: np.float32, least_gap: np.float32
) -> bool:
    return bool(cost - least >= max(uniqueness * cost, least_gap))


@part
def _best(
    cost: _Shorts, u: np.float32, reduction: int, uniqueness: np.float32, least_gap: np.float32
) -> np.float32:
    """Return the disparity, px, of least cost (K,), by a parabola; NaN if ambiguous or outside."""
    last = len(cost) - 1
    best = _least(cost)
    rest = _MOST
    for k in range(last + 1):
        if (k < best - 1 or k > best + 1) and cost[k] < rest:
            rest = int(cost[k])
    least, second = np.float32(cost[best]), np.float32(rest)
    if not _clearly_less(least, second, uniqueness, least_gap):
        return np.float32(np.nan)
    between = np.float32(0.0)
    # The first and the last have only one neighbour, so no parabola.
    if 0 < best < last:
        before, after = np.float32(cost[best - 1]), np.float32(cost[best + 1])
        bend = max(before + after - (least + least), np.float32(1.0))
        between = min(max((before - after) / (bend + bend), -_HALF), _HALF)
    disparity = reduction * (float(last - best) - float(between))
    return np.float32(disparity) if disparity <= u else np.float32(np.nan)


@part
def _recurs(cost: _Shorts, own: int, share: np.float32) -> bool:
    """Return whether a block recurs on its row, by its SADs (K,) against blocks of its own image.

    Args:
        own: number of the block itself. share: of the mean, below which another local minimum
            shows the same texture.
    """
    least, total = _MOST, 0
    for k in range(len(cost)):
        total += int(cost[k])
    for k in range(1, len(cost) - 1):
        minimum = cost[k] <= cost[k - 1] and cost[k] <= cost[k + 1]
        if minimum and (k < own - 1 or k > own + 1) and cost[k] < least:
            least = int(cost[k])
    return bool(np.float32(least) * np.float32(len(cost)) < share * np.float32(total))


@part
def _block(px: Singles, reduction: int, side: int, shape: tuple[int, int]) -> tuple[int, int]:
    """Return row and column at which the block around a point (2,) px begins."""
    column = min(int(np.rint(px[0] / reduction)), shape[1] - side)
    row = min(int(np.rint(px[1] / reduction)), shape[0] - side)
    return row, column


@kernel(BYTES2, BYTES2, SINGLES2, WHOLE, WHOLE, WHOLE, SINGLE, SINGLE, SINGLE)
def search_rows(
    first: Bytes,
    second: Bytes,
    px: Singles,
    reduction: int,
    side: int,
    count: int,
    uniqueness: np.float32,
    least_gap: np.float32,
    recurrence: np.float32,
) -> tuple[Singles, Flags]:
    """Find the disparities at which the blocks around N points match best.

    A block that recurs on its own row also matches the other image at several disparities, and
    what is seen between the repetitions may make a wrong one the best (Manduchi and Tomasi:
    Distinctiveness Maps for Image Matching, ICIAP 1999).

    Args:
        first, second: (h, w), (h, w + count) left and right image, reduced, each padded by half a
            block on every side, and the second by ``count`` more columns at the left.
        px: (N, 2) pixels in the left image. reduction: how many times smaller the images are.
        side: of a block. count: the largest disparity, both in pixels of the reduced images.
        uniqueness: share, and least_gap: sum of differences, by which the best cost must be below
            those of all disparities but its neighbours.
        recurrence: share of the mean cost within its own row below which a block recurs there.

    Returns:
        The disparities (N,) px, NaN unknown, and which of the blocks recur, (N,).
    """
    found = np.empty(len(px), np.float32)
    recurs = np.zeros(len(px), np.bool_)
    # Number k has the disparity count - k.
    cost = np.empty(count + 1, np.uint16)
    own = np.empty(2 * count + 1, np.uint16)
    for n in range(len(px)):
        row, column = _block(px[n], reduction, side, first.shape)
        _costs(first, row, column, second, column, side, cost)
        found[n] = _best(cost, px[n, 0], reduction, uniqueness, least_gap)
        if np.isnan(found[n]):
            continue
        begin = max(column - count, 0)
        around = own[: min(column + count, first.shape[1] - side) - begin + 1]
        _costs(first, row, column, first, begin, side, around)
        recurs[n] = _recurs(around, column - begin, recurrence)
    return found, recurs


@part
def _contradicts(
    cost: _Shorts,
    held: np.float32,
    found: np.float32,
    reduction: int,
    uniqueness: np.float32,
    least_gap: np.float32,
    near_px: np.float32,
) -> bool:
    """Return whether costs (K,) contradict a disparity, px; ``found`` is the unique one, or NaN."""
    if not np.isnan(found):
        return bool(abs(found - held) > near_px)
    last, best, own = len(cost) - 1, _least(cost), _MOST
    for k in range(last + 1):
        if abs(reduction * (last - k) - held) <= near_px and cost[k] < own:
            own = int(cost[k])
    return _clearly_less(np.float32(cost[best]), np.float32(own), uniqueness, least_gap)


@kernel(BYTES2, BYTES2, SINGLES2, SINGLES1, WHOLE, WHOLE, WHOLE, SINGLE, SINGLE, SINGLE)
def contradicted_by_rows(
    first: Bytes,
    second: Bytes,
    px: Singles,
    held: Singles,
    reduction: int,
    side: int,
    count: int,
    uniqueness: np.float32,
    least_gap: np.float32,
    near_px: np.float32,
) -> Flags:
    """(N,) for which of N points another disparity matches clearly better than the one they have.

    Args:
        held: (N,) px, the disparities; what has none, NaN, is not contradicted.
        near_px: pixels; disparities that differ by more belong to different surfaces.
        The rest are as for ``search_rows``.
    """
    wrong = np.zeros(len(px), np.bool_)
    cost = np.empty(count + 1, np.uint16)
    for n in range(len(px)):
        if np.isnan(held[n]):
            continue
        row, column = _block(px[n], reduction, side, first.shape)
        _costs(first, row, column, second, column, side, cost)
        found = _best(cost, px[n, 0], reduction, uniqueness, least_gap)
        wrong[n] = _contradicts(cost, held[n], found, reduction, uniqueness, least_gap, near_px)
    return wrong


@kernel(BYTES2, BYTES2, WHOLES2, WHOLES1, WHOLES1, WHOLE)
def least_differences(
    first: Bytes,
    second: Bytes,
    cells: Indices,
    lowest: Indices,
    highest: Indices,
    side: int,
) -> Singles:
    """(N,) mean absolute differences between the block around each of N cells and its best match.

    Args:
        first, second: (h, w) left and right image. cells: (N, 2) columns and rows.
        lowest, highest: (N,) the disparities, cells, from and up to which blocks are compared.
        side: of a block; odd.

    Returns:
        The least differences; infinite where no block lies in both images.
    """
    out = np.full(len(cells), np.inf, np.float32)
    height, width = first.shape
    for n in range(len(cells)):
        column, row = cells[n, 0] - side // 2, cells[n, 1] - side // 2
        begin, end = max(column - highest[n], 0), min(column - lowest[n], width - side)
        if column < 0 or row < 0 or column + side > width or row + side > height or end < begin:
            continue
        cost = np.empty(end - begin + 1, np.uint16)
        _costs(first, row, column, second, begin, side, cost)
        out[n] = np.float32(cost[_least(cost)]) / np.float32(side * side)
    return out
