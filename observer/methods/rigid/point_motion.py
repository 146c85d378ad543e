"""Motion of the tracked points: as the motion test finds it, and as it is shown and explained."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array


@dataclass(frozen=True, eq=False)
class PooledMotion:
    """Motion of N points, pooled over their neighbours.

    Attributes:
        own_velocity: (N, 3) m/s, world, of each point alone. own_information: (N, 3, 3).
        judged: (N,) whether the point was seen often enough. window_s: (N,) over how long.
        position: (N, 3) metres, world, now. position_cov: (N, 3, 3).
        shared_cov: (N, 3, 3) (m/s)^2, of all velocities here, by errors that all points share.
        velocity: (N, 3) m/s, world, pooled. covariance: (N, 3, 3), of ``velocity``.
        significance: (N,) Mahalanobis length of ``velocity``; 0 where nothing can be said.
        neighbours: (N,) how many points were pooled, each one itself included.
        threshold: Mahalanobis length above which a point counts as dynamic.
        dynamic: (N,).
        pairs: (P, 2) indices of points that agree in place and velocity.
    """

    own_velocity: Float64Array
    own_information: Float64Array
    judged: NDArray[np.bool_]
    window_s: Float64Array
    position: Float64Array
    position_cov: Float64Array
    shared_cov: Float64Array
    velocity: Float64Array
    covariance: Float64Array
    significance: Float64Array
    neighbours: NDArray[np.int64]
    threshold: float
    dynamic: NDArray[np.bool_]
    pairs: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class PointEvidence:
    """The motion of N followed features at one frame, and how sure it is.

    Attributes:
        px: (N, 2) float32 pixels in the rectified left image of this frame.
        depth: (N,) metres, NaN = unknown.
        age_s: (N,) seconds for which each has been followed.
        velocity: (N, 3) m/s over ground, camera axes, pooled over the neighbours.
        velocity_std: (N,) m/s, one standard deviation of it.
        significance: (N,) Mahalanobis length of the velocity: standard deviations from standing.
        threshold: the Mahalanobis length above which a feature counts as dynamic.
        dynamic: (N,) which ones count as dynamic.
        neighbours: (N,) how many features were pooled.
        obstacle_id: (N,) number of the obstacle each belongs to, -1 = none;
            below that it is not confirmed yet.
        cornered: (N,) whether its texture varies in more than one direction; along a straight
            edge a match may slide, and is no evidence.
        on_outline: (N,) whether it is seen on the outline of its obstacle.
    """

    px: NDArray[np.float32]
    depth: Float64Array
    age_s: Float64Array
    velocity: Float64Array
    velocity_std: Float64Array
    significance: Float64Array
    threshold: float
    dynamic: NDArray[np.bool_]
    neighbours: NDArray[np.int_]
    obstacle_id: NDArray[np.int_]
    cornered: NDArray[np.bool_]
    on_outline: NDArray[np.bool_]
