"""Evidence of motion along lines of sight, as the motion test finds it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array


@dataclass(frozen=True, eq=False)
class RayEvidence:
    """Motion of N points in the image beyond that of static ones.

    Attributes:
        significance: (N,) standard deviations; 0 where nothing can be said.
        threshold: above which a point counts as moving.
        moving: (N,). neighbours: (N,) how many points were pooled. pairs: (P, 2) that agree.
    """

    significance: Float64Array
    threshold: float
    moving: NDArray[np.bool_]
    neighbours: NDArray[np.int64]
    pairs: NDArray[np.intp]
