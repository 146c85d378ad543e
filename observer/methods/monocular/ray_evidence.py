"""What is known of which points can stand, as one stage finds it and others use it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array


@dataclass(frozen=True, eq=False)
class RayEvidence:
    """What is known of the motion of N points in the image beyond standing.

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
