"""Robust statistics of a few values, as every frame needs them dozens of times."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

# Of normally distributed values the median absolute deviation, times this, is the standard
# deviation: 1 / the 75 % quantile of the normal distribution.
MAD_TO_SIGMA: Final = 1.4826


def median(values: NDArray[np.floating[Any] | np.integer[Any]]) -> float:
    """Return the median of values (N,), at least one and none NaN.

    Equal to ``numpy.median``, in an eighth of its time for a few hundred values: that looks for
    NaN and for axes first.
    """
    middle = len(values) // 2
    ordered = np.partition(values, middle)
    if len(values) % 2:
        return float(ordered[middle])
    return (float(ordered[:middle].max()) + float(ordered[middle])) / 2
