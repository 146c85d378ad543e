"""Oracle of ``observer.kernels.trunk_shift``: the same by numpy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.robust import MAD_TO_SIGMA, median

# Robust mean: deviations from which weights fall, and beyond which a point starts from a new
# place. The noise of points on one body is correlated by ``_CORRELATED``.
_FULL_SIGMAS, _LEAVE_SIGMAS = 2.0, 4.0
_STEPS = 3
# A point repeats most of its error in the next frame, so two sightings differ by less.
_LEAST_SCALE = 0.3
_CORRELATED = 0.1


def trunk_shift(
    number: NDArray[np.int64],
    place: Float64Array,
    information: Float64Array,
    origin: Float64Array,
    ahead: Float64Array,
    number_before: NDArray[np.int64],
    offset_before: Float64Array,
    variance_before: Float64Array,
    least: int,
) -> tuple[Float64Array, NDArray[np.int64], float, float]:
    """Return how far points went along the line of sight, see the kernel."""
    variance = np.einsum("i,nij,j->n", ahead, np.linalg.inv(information), ahead)
    _, now, then = np.intersect1d(number, number_before, assume_unique=True, return_indices=True)
    before = np.full(len(number), -1)
    mean, mean_variance, fits = 0.0, np.inf, np.ones(len(now), np.bool_)
    if len(now) >= least:
        moved = (place[now] - origin - offset_before[then]) @ ahead
        mean, mean_variance, fits = robust_mean(moved, variance[now] + variance_before[then])
    before[now[fits]] = then[fits]
    return variance, before, mean, mean_variance


def robust_mean(
    moved: Float64Array, variance: Float64Array
) -> tuple[float, float, NDArray[np.bool_]]:
    """Return the mean of (N,) metres with variances (N,), its own variance, and which fit."""
    mean = median(moved)
    for _ in range(_STEPS):
        length = np.abs(moved - mean) / np.sqrt(variance)
        scale = max(_LEAST_SCALE, median(length) * MAD_TO_SIGMA)
        fits = length <= _LEAVE_SIGMAS * scale
        weight = np.minimum(1.0, _FULL_SIGMAS * scale / np.maximum(length, 1e-9)) * fits / variance
        mean = float(weight @ moved / weight.sum())
    used = np.count_nonzero(fits)
    return mean, float(scale**2 * (1 + _CORRELATED * used) / weight.sum()), fits
