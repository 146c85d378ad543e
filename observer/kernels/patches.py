"""Patches of connected image cells: their distance, and the cell at their centre."""

from __future__ import annotations

import numpy as np

from observer.kernels.compiled import INTS2, REALS2, SINGLES2, Indices, Ints, Reals, Singles, kernel
from observer.kernels.small import median


@kernel(INTS2, INTS2, REALS2, SINGLES2)
def describe_patches(
    labels: Ints, stats: Ints, middles: Reals, disparity: Singles
) -> tuple[Reals, Indices]:
    """Return the median disparity (L,) of each patch, and row and column (L, 2) at its centre.

    The latter are those of its own cell that is nearest to its centroid.

    Args:
        labels: (h, w) number of the patch of each cell, 0 none. stats: (L, 5) and middles: (L, 2),
            as of OpenCV's ``connectedComponentsWithStats``; the first entry is the background.
        disparity: (h, w) px, known wherever there is a patch.
    """
    count = len(stats)
    typical, nearest = np.zeros(count), np.zeros((count, 2), np.int64)
    scratch = np.empty(labels.size)
    for label in range(1, count):
        left, top, width, height = (
            stats[label, 0], stats[label, 1], stats[label, 2], stats[label, 3],
        )  # fmt: skip
        found, least = 0, np.inf
        for row in range(top, top + height):
            for column in range(left, left + width):
                if labels[row, column] != label:
                    continue
                scratch[found] = disparity[row, column]
                found += 1
                across, down = column - middles[label, 0], row - middles[label, 1]
                apart = across * across + down * down
                if apart < least:
                    nearest[label, 0], nearest[label, 1], least = row, column, apart
        typical[label] = median(scratch[:found])
    return typical, nearest
