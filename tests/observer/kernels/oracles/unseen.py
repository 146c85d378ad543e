"""Oracle of ``observer.kernels.unseen``: the same by numpy and OpenCV."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]
Weights = NDArray[np.float32]

# Share of the known surroundings of a plain region that must be static: overall, and nearby.
_STANDING_AROUND, _STANDING_NEARBY = 0.8, 0.5
# Share of a plain region's border that must be known to be static.
_KNOWN_BORDER = 0.25


def cell_means(values: NDArray[np.uint8], side: int) -> Weights:
    """Means (rows, columns) over the cells of values (h, w)."""
    height, width = values.shape
    rows, columns = -(-height // side), -(-width // side)
    whole = cv2.copyMakeBorder(
        values.astype(np.float32), 0, rows * side - height, 0, columns * side - width,
        cv2.BORDER_REPLICATE,
    )  # fmt: skip
    means = cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA)
    return np.asarray(means, np.float32)


def told_by_points(
    known: Weights,
    stands: Weights,
    moves: Weights,
    at: tuple[NDArray[np.intp], NDArray[np.intp]],
    dynamic: Mask,
    least: np.float32,
) -> tuple[Weights, Weights, Weights]:
    """Shares (rows, columns) updated with the points in rows (N,) and columns (N,)."""
    rows, columns = at
    still, moving = np.zeros(known.shape, np.bool_), np.zeros(known.shape, np.bool_)
    still[rows[~dynamic], columns[~dynamic]] = True
    moving[rows[dynamic], columns[dynamic]] = True
    known = np.where(still | moving, np.maximum(known, least), known)
    stands = np.where(still & ~moving & (moves == 0), known, stands)
    return known, stands, np.where(moving, known, moves)


def background(plain: Mask, stands: Weights, moves: Weights, fits: tuple[int, int]) -> Mask:
    """Cells (rows, columns) of plain regions whose known surroundings are nearly all static.

    Args:
        fits: rows and columns of the window that a person fills.
    """
    count, labels = cv2.connectedComponents(plain.view(np.uint8), connectivity=4)
    rows, columns = labels.shape
    wide = np.pad(labels, 1)
    around = np.zeros((3, count))
    for down, across in ((0, 1), (2, 1), (1, 0), (1, 2)):
        beside = wide[down : down + rows, across : across + columns][~plain]
        for sums, weights in zip(around, (stands, moves, np.ones_like(stands)), strict=True):
            sums += np.bincount(beside, weights[~plain], count)
    still, moving, border = around
    sure = (still > 0) & (still >= _KNOWN_BORDER * border)
    sure &= still >= _STANDING_AROUND * (still + moving)
    sure[0] = False
    size = (2 * (fits[1] // 2) + 1, 2 * (fits[0] // 2) + 1)
    near, moved = (
        cv2.boxFilter(w, -1, size, borderType=cv2.BORDER_CONSTANT) for w in (stands, moves)
    )
    return np.asarray(sure[labels] & (near >= _STANDING_NEARBY * (near + moved)), np.bool_)


def fills(cells: Mask, fits: tuple[int, int], share: float) -> bool:
    """True if the cells (rows, columns) fill this share of any window of ``fits`` rows, columns."""
    rows, columns = min(fits[0], cells.shape[0]), min(fits[1], cells.shape[1])
    total = np.pad(cells.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    inside = total[rows:, columns:] - total[:-rows, columns:]
    inside = inside - total[rows:, :-columns] + total[:-rows, :-columns]
    return bool(inside.max() >= share * rows * columns)
