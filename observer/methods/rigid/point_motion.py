"""Motion of the tracked points: as found by the motion test, and as shown and explained."""

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
        judged: (N,) whether the point was seen often enough to be tested.
        window_s: (N,) seconds over which it was seen.
        position: (N, 3) metres, world, now. position_cov: (N, 3, 3).
        shared_cov: (N, 3, 3) (m/s)^2, part of the velocity covariance due to errors that all
            points share.
        velocity: (N, 3) m/s, world, pooled. covariance: (N, 3, 3), of ``velocity``.
        significance: (N,) Mahalanobis length of ``velocity``; 0 where it was not tested.
        neighbours: (N,) how many points were pooled, each one itself included.
        threshold: Mahalanobis length above which a point counts as dynamic.
        dynamic: (N,) which points count as dynamic.
        pairs: (P, 2) indices of points that agree in position and velocity.
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
    """The motion of N tracked features at one frame, and its certainty.

    Attributes:
        px: (N, 2) float32 pixels in the rectified left image of this frame.
        depth: (N,) metres, NaN = unknown.
        age_s: (N,) seconds for which each has been tracked.
        velocity: (N, 3) m/s over ground, camera axes, pooled over the neighbours.
        velocity_std: (N,) m/s, one standard deviation of it.
        significance: (N,) Mahalanobis length of the velocity: standard deviations from zero.
        threshold: the Mahalanobis length above which a feature counts as dynamic.
        dynamic: (N,) which ones count as dynamic.
        neighbours: (N,) how many features were pooled.
        obstacle_id: (N,) number of the obstacle each belongs to, -1 = none; numbers below -1
            are obstacles not confirmed yet.
        cornered: (N,) whether its texture varies in more than one direction; along a straight
            edge a match may slide and is no evidence.
        recurs: (N,) whether its texture recurs along the row: its depth may be wrong, and is no
            evidence of motion.
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
    recurs: NDArray[np.bool_]
    on_outline: NDArray[np.bool_]
