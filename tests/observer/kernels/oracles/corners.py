"""Oracle of ``observer.kernels.corners``: the whole image at once, by numpy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def wanted_cells(
    taken: NDArray[np.intp], marked: NDArray[np.bool_], finer: int, turn: int, turns: int
) -> NDArray[np.bool_]:
    """(finer rows, finer columns) cells in which a point is wanted."""
    rows, columns = marked.shape
    empty = np.ones(rows * columns * (1 + finer**2), np.bool_)
    empty[taken] = False
    coarse, fine = np.split(empty, [rows * columns])
    coarse = coarse.reshape(rows, columns)
    coarse &= (np.add.outer(np.arange(rows), np.arange(columns)) + turn) % turns == 0
    return np.where(
        marked[:, None, :, None],
        fine.reshape(rows, finer, columns, finer),
        coarse[:, None, :, None],
    ).reshape(rows * finer, columns * finer)


def strongest_of_cells(
    strength: NDArray[np.float32],
    marked: NDArray[np.bool_],
    wanted: NDArray[np.bool_],
    finer: int,
    margin: int,
    step: np.float32,
    least: np.float32,
) -> NDArray[np.intp]:
    """(N, 2) column and row of the strongest pixel of every cell in which one is wanted."""
    rows, columns = marked.shape
    height, width = strength.shape
    strength = strength.copy()
    strength[:margin], strength[height - margin :] = 0, 0
    strength[:, :margin], strength[:, width - margin :] = 0, 0
    v, u = ((np.arange(n, dtype=np.float32) * step).astype(np.intp) for n in (height, width))
    best = np.zeros((rows * finer, columns * finer), np.float32)
    np.maximum.at(best, (v[:, None], u[None, :]), strength)
    blocks = best.reshape(rows, finer, columns, finer)
    whole = blocks.max(axis=(1, 3), keepdims=True)
    best = np.where(marked[:, None, :, None], blocks, whole).reshape(best.shape)
    best[~wanted | (best < least)] = np.inf
    row, column = np.nonzero(strength == best[v][:, u])
    coarse = v[row] // finer * columns + u[column] // finer
    divided = rows * columns + v[row] * (columns * finer) + u[column]
    cell = np.where(marked[v[row] // finer, u[column] // finer], divided, coarse)
    _, first = np.unique(cell, return_index=True)
    return np.stack([column, row], axis=1)[first]


def is_cornered(
    across: NDArray[np.int16],
    down: NDArray[np.int16],
    px: NDArray[np.float32],
    reduction: int,
    side: int,
    ratio: float,
) -> NDArray[np.bool_]:
    """(N,) whether the texture at (N, 2) px varies in more than one direction."""
    half = side // 2
    size = np.array(across.shape[::-1])
    columns, rows = np.clip((px / reduction).astype(np.intp), 0, size - 1).T
    gu, gv = (
        np.lib.stride_tricks.sliding_window_view(
            np.pad(gradient.astype(np.float64), half, mode="reflect"), (side, side)
        )[rows, columns]
        for gradient in (across, down)
    )
    a, b, c = (product.sum(axis=(1, 2)) for product in (gu * gu, gu * gv, gv * gv))
    matrix = np.stack([np.stack([a, b], axis=-1), np.stack([b, c], axis=-1)], axis=-1)
    smaller, larger = np.linalg.eigvalsh(matrix).T
    return np.asarray(smaller >= ratio * larger)
