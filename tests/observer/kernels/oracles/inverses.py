"""Oracle of ``observer.kernels.inverses``: the same formulas for all matrices at once, by numpy."""

from __future__ import annotations

import numpy as np

from observer.geometry import Float64Array


def inverse_3x3(matrices: Float64Array) -> Float64Array:
    """Inverses (N, 3, 3) of symmetric positive matrices (N, 3, 3), by cofactors.

    For thousands of small matrices this is several times faster than ``numpy.linalg.inv``. A
    matrix without an inverse gives huge numbers or infinities, never an error.
    """
    m = np.asarray(matrices, dtype=np.float64)
    # One row per entry and operations on whole rows: few calls on contiguous memory.
    entries = np.ascontiguousarray(m.reshape(-1, 9).T)
    inverse = entries.take(_COFACTORS[0], axis=0)
    inverse *= entries.take(_COFACTORS[1], axis=0)
    inverse -= entries.take(_COFACTORS[2], axis=0) * entries.take(_COFACTORS[3], axis=0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        inverse *= 1 / (entries[:3] * inverse[:3]).sum(axis=0)
    return np.asarray(inverse.T.take(_SYMMETRIC, axis=1).reshape(-1, 3, 3), np.float64)


# The six distinct entries of the adjugate of a symmetric matrix, entries numbered row by row:
# the first times the second minus the third times the fourth.
_COFACTORS = np.array(
    [[4, 2, 1, 0, 1, 0], [8, 5, 5, 8, 2, 4], [5, 1, 2, 2, 0, 1], [5, 8, 4, 2, 5, 1]]
)
# Index of the entry at each of the nine places.
_SYMMETRIC = np.array([0, 1, 2, 1, 3, 4, 2, 4, 5])
