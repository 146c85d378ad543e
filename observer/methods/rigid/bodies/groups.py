"""Groups of points that move alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.methods.rigid.point_motion import PooledMotion
from observer.parameters import ObstacleParameters
from observer.robust import MAD_TO_SIGMA

# Standard deviations: a member further than this from the middle of a group is dropped.
_STRAY = 4.0
# (m/s)^2: the velocity of a group is never known better than to a millimetre per second.
_LEAST_VELOCITY_VARIANCE = 1e-6
# Share of a body's points that may lie on the ground, as shadows do.
_LYING_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class Group:
    """Points that move alike.

    Attributes:
        members: (K,) their indices. places: (K, 3) metres, world. centre: (3,), their median.
        velocity: (3,) m/s, world, with covariance (3, 3).
    """

    members: NDArray[np.intp]
    places: Float64Array
    centre: Float64Array
    velocity: Float64Array
    velocity_cov: Float64Array


def group_of(
    candidates: NDArray[np.intp],
    motion: PooledMotion,
    parameters: ObstacleParameters,
    reach: float = 0.0,
) -> Group | None:
    """Group the candidates (K,), without strays; None if they are too few.

    Args:
        reach: metres within which points count as neighbours there.
    """
    members = candidates[_together(motion.position[candidates], reach)]
    if len(members) < parameters.min_points:
        return None
    information = motion.own_information[members]
    L = information.sum(axis=0)
    velocity = np.linalg.solve(L, np.einsum("nij,nj->i", information, motion.own_velocity[members]))
    cov = np.linalg.inv(L) * (1 + parameters.noise_correlation * len(members))
    places = motion.position[members]
    return Group(
        members=members,
        places=places,
        centre=np.median(places, axis=0),
        velocity=velocity,
        velocity_cov=cov + np.eye(3) * _LEAST_VELOCITY_VARIANCE,
    )


def mostly_lie(lying: NDArray[np.bool_]) -> bool:
    """Return whether so many of some points (N,) lie on the ground that they are no body."""
    return float(lying.mean()) > _LYING_SHARE


def _together(position: Float64Array, reach: float) -> NDArray[np.bool_]:
    """(N,) which of a group's places (N, 3) are not far from most of the others.

    The spread of a few points says little; nearer than ``reach`` metres none is a stray.
    """
    apart = np.abs(position - np.median(position, axis=0))
    spread = MAD_TO_SIGMA * np.median(apart, axis=0)
    allowed = np.maximum(_STRAY * spread, reach)
    return np.asarray((apart <= allowed).all(axis=1), dtype=np.bool_)
