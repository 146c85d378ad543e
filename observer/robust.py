"""Robust statistics of a few values, needed dozens of times per frame."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

# Factor from the median absolute deviation to the standard deviation of normally distributed
# values: 1 / the 75 % quantile of the normal distribution.
MAD_TO_SIGMA: Final = 1.4826
# Tukey's weight is 0 beyond this many standard deviations, and keeps 95 % of the information about
# normally distributed values.
TUKEY_SIGMAS: Final = 4.7


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


def tukey_weights(residual: NDArray[np.float64], sigma: float) -> NDArray[np.float64]:
    """Return Tukey's biweights (N,), 0 to 1, of residuals (N,) with standard deviation ``sigma``.

    For iteratively reweighted least squares (Huber, Robust Statistics, 1981).
    """
    return np.clip(1 - (residual / (TUKEY_SIGMAS * sigma)) ** 2, 0, None) ** 2
