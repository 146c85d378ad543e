"""Probability of touching somebody along a path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from observer.geometry import Float64Array
from observer.navigation.futures import Futures
from observer.navigation.rollouts import Rollouts

# The probability of being farther off than this many standard deviations is neglected.
_NEVER_SIGMAS = 5.0


@dataclass(frozen=True, eq=False)
class Risk:
    """Risk of C ways among N people.

    Attributes:
        each: (C, N) probability of touching each person.
        when_s: (C, N) seconds from now at which that is likeliest.
    """

    each: Float64Array
    when_s: Float64Array

    @property
    def total(self) -> Float64Array:
        """(C,) probability of touching anybody."""
        return np.asarray(1 - np.prod(1 - self.each, axis=1))


def risk_of(ways: Rollouts, people: Futures, radius_m: float, counts: Float64Array) -> Risk:
    """Return the risk of ways, with each instant weighted.

    All instants share the same uncertainty, so the worst one counts, not their sum.

    Args:
        radius_m: of a circle that encloses the robot.
        counts: (C, K) weight of each instant, from 0 to 1.
    """
    if not len(people):
        nothing = np.zeros((len(ways.poses), 0))
        return Risk(nothing, nothing)
    chance = _chances(ways, people, radius_m, counts)
    instant = chance.sum(axis=3).argmax(axis=0)
    return Risk(chance.max(axis=0).sum(axis=2), ways.times[instant])


def seconds_near(
    ways: Rollouts, people: Futures, radius_m: float, counts: Float64Array
) -> Float64Array:
    """(C,) expected seconds of each way with somebody within a radius; arguments as ``risk_of``.

    The probability at each instant is capped at 1.
    """
    if not len(people):
        return np.zeros(len(ways.poses))
    near = _chances(ways, people, radius_m, counts).sum(axis=(2, 3))
    return np.asarray(np.minimum(near, 1.0).sum(axis=0) * (ways.times[1] - ways.times[0]))


def _chances(
    ways: Rollouts, people: Futures, radius_m: float, counts: Float64Array
) -> Float64Array:
    """(K, C, N, M) probability of being within the two radii at each instant.

    Upper bound: the probability of being in the circle's bounding square, aligned with the line
    between the two. It is tighter than the usual bound by a half-plane (as in Zhu and Alonso-Mora,
    Chance-constrained collision avoidance for MAVs in dynamic environments, RA-L 4, 2019).
    """
    count, manoeuvres, instants = people.sigma.shape
    # Instants come first, so that all distances of an instant are one matrix product.
    at = ways.poses[:, :, :2].transpose(1, 0, 2)
    mean = people.mean.reshape(-1, instants, 2).transpose(1, 2, 0)
    squared = (at**2).sum(axis=2)[:, :, None] + (mean**2).sum(axis=1)[:, None, :] - 2 * at @ mean
    gap = np.sqrt(np.maximum(squared, 0.0)).reshape(instants, -1, count, manoeuvres)
    sigma = people.sigma.transpose(2, 0, 1)[:, None]
    reach = radius_m + people.radius[:, None]
    within = (reach - gap) / sigma
    chance = np.zeros_like(within)
    likely = within > -_NEVER_SIGMAS
    beyond = (-reach - gap) / sigma
    chance[likely] = ndtr(within[likely]) - ndtr(beyond[likely])
    across = 2 * ndtr(reach / sigma) - 1
    return np.asarray(chance * counts.T[:, :, None, None] * (across * people.weight))
