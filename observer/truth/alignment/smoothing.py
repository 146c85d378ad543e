"""Velocities without lag: symmetric windows, never a filter that only knows the past."""

from __future__ import annotations

import numpy as np

from observer.geometry import Float64Array
from observer.truth.speeds import JUMP_STEPS, smoothed_velocity


def velocities(
    times: Float64Array, positions: Float64Array, window: int, longest_step: float = JUMP_STEPS
) -> Float64Array:
    """(N, 3) m/s of positions (N, 3); NaN where the window (odd) touches a gap, or a step longer
    than so many of the median."""
    return smoothed_velocity(times, positions, window=window, order=2, longest_step=longest_step)


def angular_velocities(
    times: Float64Array, rotations: Float64Array, window: int, longest_step: float = JUMP_STEPS
) -> Float64Array:
    """(N, 3) rad/s of rotations (N, 3, 3), which are NaN in gaps.

    The rotations' columns are differentiated as positions are: with the columns' rates c' the
    angular velocity is half the sum of c x c'.
    """
    total = np.zeros((len(times), 3))
    for column in range(3):
        axis = rotations[:, :, column]
        total += np.cross(axis, velocities(times, axis, window, longest_step))
    return 0.5 * total
