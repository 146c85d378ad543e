"""Robust statistics of a few values, needed dozens of times per frame."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

# Factor from the median absolute deviation to the standard deviation of normally distributed
# values: 1 / the 75 % quantile of the normal distribution.
MAD_TO_SIGMA: Final = 1.4826


def median(values: NDArray[np.floating[Any] | np.integer[Any]]) -> float:
    """Return the median of values (N,), at least one and none NaN.

    Equal to ``numpy.median``, which takes eight times as long for a few hundred values because it
    handles NaN and axes first.
    """
    middle = len(values) // 2
    ordered = np.partition(values, middle)
    if len(values) % 2:
        return float(ordered[middle])
    return (float(ordered[:middle].max()) + float(ordered[middle])) / 2
