"""Velocities of motion capture from positions alone, by symmetric windows.

A causal filter would lag behind the motion, and the lag would look like a clock offset.
"""

from __future__ import annotations

import numpy as np

from observer.geometry import Float64Array

# A time step longer than this many median steps is a jump: samples are missing there.
JUMP_STEPS = 1.5
# Steps that differ by less than this share of the median are equal except for rounding.
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
    """Return velocities (N, 3) m/s: at each sample, the slope of a polynomial fitted around it.

    For equal time steps this is the filter of Savitzky and Golay (Smoothing and Differentiation
    of Data by Simplified Least Squares Procedures, 1964); for unequal ones it is the same fit at
    the samples' own times.

    Args:
        times: (N,) seconds, increasing. positions: (N, 3) metres, NaN rows are gaps.
        window: samples in a fit, odd. order: the polynomial's, smaller than ``window``.
        longest_step: in median steps; a longer one is a jump in time.

    Returns:
        NaN wherever the window extends beyond the data or touches a gap or a jump in time.

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
    jumps = np.concatenate([[0], np.cumsum(steps > longest_step * step)])
    inside = jumps[window - 1 :] - jumps[: count - window + 1]
    velocity[half : count - half][inside > 0] = np.nan
    return velocity


def _slope_weights(offsets: Float64Array, order: int) -> Float64Array:
    """Return weights (M, W) that give the polynomial's slope at 0 from values at ``offsets``."""
    # Scale the offsets to 1, so that the normal equations stay well conditioned.
    scale = np.abs(offsets).max(axis=1)[:, None]
    powers = (offsets / scale)[:, :, None] ** np.arange(order + 1)
    across = np.swapaxes(powers, 1, 2)
    coefficients = np.linalg.solve(across @ powers, across)
    return np.asarray(coefficients[:, 1] / scale)
