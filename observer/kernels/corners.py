"""Corners: the strongest in every cell that needs a point, and whether points are on one."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from observer.kernels.compiled import (
    FLAGS2,
    REAL,
    SHORTS2,
    SINGLE,
    SINGLES2,
    WHOLE,
    WHOLES1,
    Flags,
    Indices,
    Singles,
    kernel,
    part,
)

_Shorts = NDArray[np.int16]

_NOTHING = np.float32(0.0)


@kernel(WHOLES1, FLAGS2, WHOLE, WHOLE, WHOLE)
def wanted_cells(taken: Indices, marked: Flags, finer: int, turn: int, turns: int) -> Flags:
    """Return in which cells, divided by ``finer`` both ways, a new point is wanted.

    Args:
        taken: (N,) numbers of the cells that have a point; whole cells are numbered first, then
            the divided ones, both row by row.
        marked: (rows, columns) which are divided.
        turn: number of this turn; only one in ``turns`` of the whole cells is searched per turn.
    """
    rows, columns = marked.shape
    wanted = np.empty((rows * finer, columns * finer), np.bool_)
    for i in range(rows * finer):
        row = i // finer
        for j in range(columns * finer):
            column = j // finer
            wanted[i, j] = marked[row, column] or (row + column + turn) % turns == 0
    whole = rows * columns
    for n in range(len(taken)):
        cell = taken[n]
        if cell >= whole:
            i, j = (cell - whole) // (columns * finer), (cell - whole) % (columns * finer)
            if marked[i // finer, j // finer]:
                wanted[i, j] = False
        elif not marked[cell // columns, cell % columns]:
            for i in range(finer):
                for j in range(finer):
                    wanted[cell // columns * finer + i, cell % columns * finer + j] = False
    return wanted


@part
def _begins(step: np.float32, count: int, margin: int, begins: Indices) -> None:
    """Write the first row (or column) of each cell, and the end of the last, to begins (C,).

    Args:
        step: cells per row. count: of rows. margin: rows at both ends that belong to no cell.
    """
    cell = 0
    for n in range(count):
        while cell <= int(np.float32(n) * step):
            begins[cell] = min(max(n, margin), max(count - margin, margin))
            cell += 1
    while cell < len(begins):
        begins[cell] = max(count - margin, margin)
        cell += 1


@part
def _peak(
    strength: Singles, top: int, bottom: int, left: int, right: int, least: np.float32
) -> tuple[int, int]:
    """Return row and column of the first strongest pixel in a rectangle; -1 if too weak."""
    row, column, most = -1, -1, _NOTHING
    for i in range(top, bottom):
        for j in range(left, right):
            if strength[i, j] > most:
                row, column, most = i, j, strength[i, j]
    if most < least:
        return -1, -1
    return row, column


@kernel(SINGLES2, FLAGS2, FLAGS2, WHOLE, WHOLE, SINGLE, SINGLE)
def strongest_of_cells(
    strength: Singles,
    marked: Flags,
    wanted: Flags,
    finer: int,
    margin: int,
    step: np.float32,
    least: np.float32,
) -> Indices:
    """Find the strongest pixel, column and row (N, 2), of every cell in which one is wanted.

    Args:
        strength: (h, w) of corners. marked, wanted, finer: as of ``wanted_cells``.
        margin: pixels at the image's edges that are left out.
        step: divided cells per pixel. least: what is weaker does not count.

    Returns:
        The whole cells first, then the divided ones, both row by row.
    """
    rows, columns = marked.shape
    down, across = np.empty(rows * finer + 1, np.int64), np.empty(columns * finer + 1, np.int64)
    _begins(step, strength.shape[0], margin, down)
    _begins(step, strength.shape[1], margin, across)
    found = np.empty((rows * columns * finer * finer, 2), np.int64)
    count = 0
    for side in (finer, 1):
        for i in range(0, rows * finer, side):
            for j in range(0, columns * finer, side):
                if not wanted[i, j] or marked[i // finer, j // finer] != (side == 1):
                    continue
                bottom, right = down[i + side], across[j + side]
                row, column = _peak(strength, down[i], bottom, across[j], right, least)
                if row >= 0:
                    found[count, 0], found[count, 1] = column, row
                    count += 1
    return found[:count]


@part
def _mirrored(n: int, count: int) -> int:
    """Return the index of a row or column, mirrored at the image's edges."""
    return min(abs(n), 2 * (count - 1) - abs(n))


@kernel(SHORTS2, SHORTS2, SINGLES2, WHOLE, WHOLE, REAL)
def is_cornered(
    across: _Shorts, down: _Shorts, px: Singles, reduction: int, side: int, ratio: float
) -> Flags:
    """Return whether the texture at points (N, 2) px varies in more than one direction.

    It does where the smaller eigenvalue of the gradient matrix, summed over a window, is at least
    ``ratio`` times the larger one.

    Args:
        across, down: (h, w) gradients of an image ``reduction`` times smaller.
        side: of the window, pixels of that image.
    """
    height, width = across.shape
    half = side // 2
    cornered = np.empty(len(px), np.bool_)
    for n in range(len(px)):
        column = min(max(int(px[n, 0] / reduction), 0), width - 1)
        row = min(max(int(px[n, 1] / reduction), 0), height - 1)
        a = b = c = 0
        for i in range(row - half, row + half + 1):
            v = _mirrored(i, height)
            for j in range(column - half, column + half + 1):
                u = _mirrored(j, width)
                gu, gv = int(across[v, u]), int(down[v, u])
                a += gu * gu
                b += gu * gv
                c += gv * gv
        middle, apart = (a + c) / 2.0, math.sqrt(((a - c) / 2.0) ** 2 + float(b) ** 2)
        cornered[n] = middle - apart >= ratio * (middle + apart)
    return cornered
