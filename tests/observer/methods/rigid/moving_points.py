"""Points whose motion is known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.methods.rigid.point_motion import PooledMotion

# m/s, one standard deviation of a point's own velocity.
SIGMA = 0.03


def motion(
    places: Float64Array, velocity: Float64Array, sigma: float = SIGMA, window_s: float = 0.5
) -> PooledMotion:
    """Motion of points (N, 3) m that are known to move at (N, 3) m/s."""
    count = len(places)
    velocity = np.broadcast_to(velocity, (count, 3)).astype(float)
    eye = np.broadcast_to(np.eye(3), (count, 3, 3))
    return PooledMotion(
        own_velocity=velocity,
        own_information=eye / sigma**2,
        judged=np.ones(count, bool),
        window_s=np.full(count, window_s),
        position=np.asarray(places, float),
        position_cov=eye * 0.01**2,
        shared_cov=eye * 0.0,
        velocity=velocity,
        covariance=eye * sigma**2,
        significance=np.full(count, 10.0),
        neighbours=np.full(count, 5),
        threshold=5.0,
        dynamic=np.ones(count, bool),
        pairs=np.zeros((0, 2), np.intp),
    )


def every(points: PooledMotion) -> NDArray[np.intp]:
    return np.arange(len(points.position))
