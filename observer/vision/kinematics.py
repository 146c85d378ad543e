"""Quantities derived from an obstacle's position and velocity, alike for every method."""

from __future__ import annotations

import numpy as np

from observer.geometry import Float64Array


def speed_std(velocity: Float64Array, covariance: Float64Array) -> float:
    """Return one standard deviation of the length of a velocity, m/s.

    To first order it is the deviation along the velocity. Noise across it can only lengthen the
    vector, by tr(C_across) / (2 |v|) to second order, which matters for slow obstacles.
    """
    variance = float(np.trace(covariance))
    speed = float(np.linalg.norm(velocity))
    if speed == 0:
        return float(np.sqrt(variance))
    direction = velocity / speed
    along = float(direction @ covariance @ direction)
    lengthening = (variance - along) / (2 * speed)
    return float(np.sqrt(min(along + lengthening**2, variance)))


def closing_speed(
    position: Float64Array, velocity: Float64Array, camera_velocity: Float64Array
) -> float:
    """Return the speed, m/s, at which an obstacle at (3,) m approaches the camera.

    Velocities are (3,) m/s over ground; all in the camera's axes.
    """
    distance = max(float(np.linalg.norm(position)), 1e-9)
    return float((camera_velocity - velocity) @ position / distance)
