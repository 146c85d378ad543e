"""Inverses of many small matrices."""

from __future__ import annotations

import numpy as np

from observer.kernels.compiled import REALS3, Reals, kernel
from observer.kernels.small import inverse_symmetric


def inverse_3x3(matrices: Reals) -> Reals:
    """Return the inverses (N, 3, 3) of symmetric positive matrices (N, 3, 3), by cofactors.

    A matrix without an inverse gives huge numbers, infinities or NaN, never an error.
    """
    return inverses(np.ascontiguousarray(matrices, np.float64))


@kernel(REALS3)
def inverses(matrices: Reals) -> Reals:
    """Return the inverses; see ``inverse_3x3``."""
    out = np.empty_like(matrices)
    for i in range(len(matrices)):
        inverse_symmetric(matrices[i], out[i])
    return out
