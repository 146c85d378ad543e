"""Probability of touching somebody along a way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from observer.geometry import Float64Array
from observer.navigation.futures import Futures
from observer.navigation.rollouts import Rollouts

# So many deviations away nobody is.
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
    """Return the risk of ways, each instant counted by a share.

    The probability of being within the two radii is taken as that of being beyond a straight
    border at their distance, which is never less (as in Zhu and Alonso-Mora, Chance-constrained
    collision avoidance for MAVs in dynamic environments, RA-L 4, 2019). From instant to instant it
    is the same uncertainty, so that the worst one counts, not their sum.

    Args:
        radius_m: of a circle that holds the robot.
        counts: (C, K) share with which each instant counts.
    """
    if not len(people):
        nothing = np.zeros((len(ways.poses), 0))
        return Risk(nothing, nothing)
    count, manoeuvres, instants = people.sigma.shape
    # Instants first: then all distances are one product of matrices for each.
    at = ways.poses[:, :, :2].transpose(1, 0, 2)
    mean = people.mean.reshape(-1, instants, 2).transpose(1, 2, 0)
    squared = (at**2).sum(axis=2)[:, :, None] + (mean**2).sum(axis=1)[:, None, :] - 2 * at @ mean
    gap = np.sqrt(np.maximum(squared, 0.0)).reshape(instants, -1, count, manoeuvres)
    sigma = people.sigma.transpose(2, 0, 1)[:, None]
    within = (radius_m + people.radius[:, None] - gap) / sigma
    chance = np.zeros_like(within)
    likely = within > -_NEVER_SIGMAS
    chance[likely] = ndtr(within[likely])
    chance *= counts.T[:, :, None, None] * people.weight
    instant = chance.sum(axis=3).argmax(axis=0)
    return Risk(chance.max(axis=0).sum(axis=2), ways.times[instant])
