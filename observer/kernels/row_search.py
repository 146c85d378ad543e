"""Block matching of single points along their row of the other image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.kernels.compiled import (
    BYTES2,
    SINGLE,
    SINGLES2,
    WHOLE,
    Bytes,
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
def _costs(first: Bytes, second: Bytes, row: int, column: int, side: int, cost: _Shorts) -> None:
    """Write the SADs of a block against K blocks of the second image, left to right, to cost."""
    for k in range(len(cost)):
        cost[k] = 0
    begin = np.uint64(column)
    for i in range(row, row + side):
        at = begin
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
def _best(
    cost: _Shorts, u: np.float32, reduction: int, uniqueness: np.float32, least_gap: np.float32
) -> np.float32:
    """Return the disparity, px, of least cost (K,), by a parabola; NaN if ambiguous or outside."""
    last = len(cost) - 1
    best = 0
    for k in range(1, last + 1):
        if cost[k] < cost[best]:
            best = k
    rest = _MOST
    for k in range(last + 1):
        if (k < best - 1 or k > best + 1) and cost[k] < rest:
            rest = int(cost[k])
    least, second = np.float32(cost[best]), np.float32(rest)
    if not second - least >= max(uniqueness * second, least_gap):
        return np.float32(np.nan)
    between = np.float32(0.0)
    # The first and the last have only one neighbour, so no parabola.
    if 0 < best < last:
        before, after = np.float32(cost[best - 1]), np.float32(cost[best + 1])
        bend = max(before + after - (least + least), np.float32(1.0))
        between = min(max((before - after) / (bend + bend), -_HALF), _HALF)
    disparity = reduction * (float(last - best) - float(between))
    return np.float32(disparity) if disparity <= u else np.float32(np.nan)


@kernel(BYTES2, BYTES2, SINGLES2, WHOLE, WHOLE, WHOLE, SINGLE, SINGLE)
def search_rows(
    first: Bytes,
    second: Bytes,
    px: Singles,
    reduction: int,
    side: int,
    count: int,
    uniqueness: np.float32,
    least_gap: np.float32,
) -> Singles:
    """Find the disparities (N,) px, NaN unknown, at which the blocks around N points match best.

    Args:
        first, second: (h, w), (h, w + count) left and right image, reduced, each padded by half a
            block on every side, and the second by ``count`` more columns at the left.
        px: (N, 2) pixels in the left image. reduction: how many times smaller the images are.
        side: of a block. count: the largest disparity, both in pixels of the reduced images.
        uniqueness: share, and least_gap: sum of differences, by which the best cost must be below
            those of all disparities but its neighbours.
    """
    found = np.empty(len(px), np.float32)
    # Number k has the disparity count - k.
    cost = np.empty(count + 1, np.uint16)
    for n in range(len(px)):
        column = min(int(np.rint(px[n, 0] / reduction)), first.shape[1] - side)
        row = min(int(np.rint(px[n, 1] / reduction)), first.shape[0] - side)
        _costs(first, second, row, column, side, cost)
        found[n] = _best(cost, px[n, 0], reduction, uniqueness, least_gap)
    return found
