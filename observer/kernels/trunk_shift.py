"""Shift of the points on a trunk along the line of sight, relative to its body."""

from __future__ import annotations

import math

import numpy as np

from observer.kernels.compiled import (
    REALS1,
    REALS2,
    REALS3,
    WHOLE,
    WHOLES1,
    Indices,
    Reals,
    kernel,
    part,
)
from observer.kernels.small import inverse_symmetric, median, squared_length
from observer.robust import MAD_TO_SIGMA

# Standard deviations, robust mean: weights fall beyond the first; a point beyond the second counts
# as having changed its place.
_FULL_SIGMAS, _LEAVE_SIGMAS = 2.0, 4.0
_STEPS = 3
# Least scale of the residuals, below 1: most of a sighting's error persists in the next frame, so
# two sightings differ by less than their noise.
_LEAST_SCALE = 0.3
# Share of the noise that points on one body have in common.
_CORRELATED = 0.1


@part
def _robust_mean(moved: Reals, variance: Reals, length: Reals) -> tuple[float, float, float]:
    """Return the robust mean of (N,) metres with variances (N,), its variance, and a limit.

    Args:
        length: (N,) is written: residuals in standard deviations; those above the limit do not fit.
    """
    count = len(moved)
    scratch = moved.copy()
    mean, scale, used, whole = median(scratch), 0.0, 0, 0.0
    for _ in range(_STEPS):
        for i in range(count):
            length[i] = abs(moved[i] - mean) / math.sqrt(variance[i])
            scratch[i] = length[i]
        scale = max(_LEAST_SCALE, median(scratch) * MAD_TO_SIGMA)
        total, whole, used = 0.0, 0.0, 0
        for i in range(count):
            if length[i] <= _LEAVE_SIGMAS * scale:
                weight = min(1.0, _FULL_SIGMAS * scale / max(length[i], 1e-9)) / variance[i]
                total += weight * moved[i]
                whole += weight
                used += 1
        mean = total / whole
    return mean, scale * scale * (1.0 + _CORRELATED * used) / whole, _LEAVE_SIGMAS * scale


@kernel(WHOLES1, REALS2, REALS3, REALS1, REALS1, WHOLES1, REALS2, REALS1, WHOLE)
def trunk_shift(
    number: Indices, place: Reals, information: Reals, origin: Reals, ahead: Reals,
    number_before: Indices, offset_before: Reals, variance_before: Reals, least: int,
) -> tuple[Reals, Indices, float, float]:  # fmt: skip
    """Measure how far points moved along the line of sight, from those that were seen before.

    Args:
        number: (K,) of each point. place: (K, 3) metres, world, with information (K, 3, 3).
        origin: (3,) metres, world, of the body as predicted. ahead: (3,) along the line of sight,
            unit length.
        number_before: (M,) of points before. offset_before: (M, 3) metres, world axes, from the
            origin. variance_before: (M,) m^2, along the line of sight.
        least: fewest common points for a result.

    Returns:
        Variance (K,) along the line of sight, m^2; index (K,) of the same point before, -1 if none
        fits; how far all moved, metres, and its variance, m^2, infinite if unknown.
    """
    count = len(number)
    variance, before = np.empty(count), np.empty(count, np.int64)
    inverse = np.empty((3, 3))
    known = 0
    for i in range(count):
        inverse_symmetric(information[i], inverse)
        variance[i] = squared_length(ahead, inverse)
        before[i] = -1
        for k in range(len(number_before)):
            if number_before[k] == number[i]:
                before[i] = k
                known += 1
                break
    if known < least:
        return variance, before, 0.0, np.inf
    moved, spread, length = np.empty(known), np.empty(known), np.empty(known)
    which = 0
    for i in range(count):
        k = before[i]
        if k < 0:
            continue
        moved[which] = 0.0
        for j in range(3):
            moved[which] += (place[i, j] - origin[j] - offset_before[k, j]) * ahead[j]
        spread[which] = variance[i] + variance_before[k]
        which += 1
    mean, mean_variance, most = _robust_mean(moved, spread, length)
    which = 0
    for i in range(count):
        if before[i] >= 0:
            if not length[which] <= most:
                before[i] = -1
            which += 1
    return variance, before, mean, mean_variance
