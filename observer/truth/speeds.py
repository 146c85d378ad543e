"""Velocities of what motion capture saw, from positions alone; nothing here looks only backwards.

A causal filter's output lags behind the motion, and that lag would be taken for a clock's offset.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array

# A step in time longer than this many of the median step is a jump: samples are missing there.
JUMP_STEPS = 1.5
# Steps that differ by less than this share of the median are equal but for rounding.
_EQUAL_STEPS = 1e-6
# Windows fitted at once, which bounds the memory.
_AT_ONCE = 20_000


def smoothed_velocity(
    times: Float64Array,
    positions: Float64Array,
    *,
    window: int = 11,
    order: int = 2,
    longest_step: float = JUMP_STEPS,
) -> Float64Array:
    """Velocities (N, 3) m/s: the slope, at each sample, of a polynomial fitted around it.

    For equal steps in time this is the filter of Savitzky and Golay (Smoothing and
    Differentiation of Data by Simplified Least Squares Procedures, 1964); for unequal ones the
    same fit at the samples' own times.

    Args:
        times: (N,) seconds, rising. positions: (N, 3) metres, NaN rows are gaps.
        window: samples in a fit, odd. order: the polynomial's, smaller than ``window``.
        longest_step: what is longer than so many of the median step is a jump in time.

    Returns:
        NaN wherever the window leaves the data or touches a gap or a jump in time.

    Raises:
        ValueError: ``window`` is even, or not larger than ``order``, or ``order`` is below 1.
    """
    if window % 2 == 0 or not 1 <= order < window:
        raise ValueError(f"window must be odd and larger than order, not {window} and {order}")
    count = len(times)
    velocity = np.full((count, 3), np.nan)
    if count < window:
        return velocity
    steps = np.diff(times)
    step = float(np.median(steps))
    half = window // 2
    equal = bool((np.abs(steps - step) <= _EQUAL_STEPS * step).all())
    for first in range(0, count - window + 1, _AT_ONCE):
        fits = min(_AT_ONCE, count - window + 1 - first)
        some = times[first : first + (1 if equal else fits) + window - 1]
        windows = np.lib.stride_tricks.sliding_window_view(some, window)
        slopes = _slope_weights((windows - windows[:, half, None]) / step, order) / step
        total = np.zeros((fits, 3))
        for k in range(window):
            total += slopes[:, k, None] * positions[first + k : first + k + fits]
        velocity[first + half : first + half + fits] = total
    jumps = np.concatenate([[0], np.cumsum(_jumps(times, longest_step))])
    inside = jumps[window - 1 :] - jumps[: count - window + 1]
    velocity[half : count - half][inside > 0] = np.nan
    return velocity


def two_point_speeds(
    times: Float64Array, positions: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Speeds between samples in a row, where they belong: at the interval's midpoint.

    Args:
        times: (N,) seconds, rising. positions: (N, 3) metres, NaN rows are gaps.

    Returns:
        Midpoints (N - 1,) in seconds and speeds (N - 1,) in m/s; NaN where either end is a gap,
        or the interval a jump in time (longer than 1.5 of the median).
    """
    middles = (times[1:] + times[:-1]) / 2
    moved = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    speeds = np.where(_jumps(times, JUMP_STEPS), np.nan, moved / np.diff(times))
    return np.asarray(middles), np.asarray(speeds)


def _jumps(times: Float64Array, longest_step: float) -> NDArray[np.bool_]:
    """(N - 1,) which steps are jumps in time."""
    steps = np.diff(times)
    if not len(steps):
        return np.zeros(0, dtype=np.bool_)
    return np.asarray(steps > longest_step * np.median(steps))


def _slope_weights(offsets: Float64Array, order: int) -> Float64Array:
    """Weights (M, W) of values at ``offsets`` (M, W) in the fitted polynomial's slope at 0."""
    # About the offsets' size one, so that the normal equations stay well conditioned.
    scale = np.abs(offsets).max(axis=1)[:, None]
    powers = (offsets / scale)[:, :, None] ** np.arange(order + 1)
    across = np.swapaxes(powers, 1, 2)
    coefficients = np.linalg.solve(across @ powers, across)
    return np.asarray(coefficients[:, 1] / scale)
