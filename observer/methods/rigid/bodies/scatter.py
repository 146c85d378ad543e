"""Scatter of the motions of the points on a rigid body, whatever their noise is said to be.

Points slide along curved surfaces as the view of them changes, stick to what is behind, and follow
plain clothes badly. None of this is noise of a known size, but all of it shows in how far the
points' own velocities differ from each other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.chi_square import quantile
from observer.geometry import Float64Array
from observer.methods.rigid.bodies.filter import POSITION, turning_velocity
from observer.methods.rigid.bodies.recent_motion import RecentMotion
from observer.methods.rigid.point_motion import PooledMotion
from observer.robust import MAD_TO_SIGMA, median

# With fewer points it is not known how far they differ.
_LEAST_POINTS = 6
# The variance of a median is this many times that of a mean, and neighbours err alike, so each
# counts as half a point.
_MEDIAN_VARIANCE = math.pi / 2
_INDEPENDENT_SHARE = 0.5
# Median of chi-squared with three degrees of freedom.
_MEDIAN_CHI2 = quantile(0.5, df=3)


@dataclass(frozen=True, eq=False)
class Scatter:
    """Scatter of the velocities of a body's points.

    Attributes:
        points: how many were compared.
        spread: (3,) m/s, world: one standard deviation of a single point's velocity.
        excess: by how many times its square is larger than the points' own noise explains; 1 or
            more.
    """

    points: int
    spread: Float64Array
    excess: float

    @property
    def level_mps(self) -> float:
        """Spread along the ground, m/s."""
        return float(np.hypot(self.spread[0], self.spread[2]))

    def doubt(self, velocity_cov: Float64Array) -> Float64Array:
        """Return by how much more uncertain a body's velocity is than noise makes it.

        As many times as the scatter exceeds the noise, but no more than the median of the points.

        Args:
            velocity_cov: (3, 3) (m/s)^2, world, by their noise.

        Returns:
            (3, 3) (m/s)^2, world.
        """
        independent = _INDEPENDENT_SHARE * self.points
        of_median = _MEDIAN_VARIANCE * self.spread**2 / independent
        return np.diag(np.minimum((self.excess - 1) * np.diag(velocity_cov), of_median))


def scatter_of(
    members: NDArray[np.intp], motion: PooledMotion, mean: Float64Array, recent: RecentMotion
) -> Scatter | None:
    """Return how far the points (N,) on a rigid body differ in how they move; None if unknown.

    Each is compared with how the body moved in the middle of the time over which that point was
    seen, if that is known: before it was found, the body may have stood. What its acceleration
    within that time may explain is left out.

    Args:
        mean: (8,) the state of the body's filter. recent: how it moved until now.
    """
    members = members[motion.judged[members] & (motion.window_s[members] / 2 <= recent.known_s)]
    if len(members) < _LEAST_POINTS:
        return None
    window = motion.window_s[members]
    then = recent.at(window / 2)
    arm = motion.position[members] - mean[POSITION]
    gap = motion.own_velocity[members] - then[:, :3] - turning_velocity(then[:, 3], arm)
    explained = recent.acceleration(window) * window / 4
    gap -= np.median(gap, axis=0)
    apart = np.sign(gap) * np.maximum(0.0, np.abs(gap) - explained[:, None])
    squared = np.einsum("ni,nij,nj->n", apart, motion.own_information[members], apart)
    return Scatter(
        points=len(members),
        spread=MAD_TO_SIGMA * np.median(np.abs(apart), axis=0),
        excess=max(1.0, median(squared) / _MEDIAN_CHI2),
    )
