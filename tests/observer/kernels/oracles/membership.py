"""Oracle of ``observer.kernels.membership``: the same formulas by numpy."""

from __future__ import annotations

import numpy as np

from observer.geometry import Float64Array
from observer.methods.rigid.bodies.filter import POSITION, VELOCITY, YAW_RATE, turning_velocity

# Share of a body's speed at which a static point beside it may seem to creep.
_AT_REST = 0.03
# Share of its speed that a body may gain or lose in a second.
_BRAKING_PER_S = 0.5
# Share of a body's yaw rate that it may not have had yet when a point was first seen.
_TURN_DOUBT = 0.5


def against_rest(
    velocity: Float64Array,
    information: Float64Array,
    shared_cov: Float64Array,
    window_s: Float64Array,
    place: Float64Array,
    state: Float64Array,
    ago: Float64Array,
    moved: Float64Array,
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Compare "moves with a body" with "rests" for N points, see the kernel."""
    noise = np.linalg.inv(information + 1e-6 * np.eye(3))
    speed = float(np.linalg.norm(state[VELOCITY]))
    lag = speed * (abs(state[YAW_RATE]) + _BRAKING_PER_S) * window_s / 2
    body_cov = noise + lag[:, None, None] ** 2 * np.eye(3)
    rest_cov = noise + shared_cov + (_AT_REST * speed) ** 2 * np.eye(3)
    arm = place - state[POSITION]
    does = state[VELOCITY] + turning_velocity(state[YAW_RATE], arm)
    apart, now = moves_along(velocity, velocity - does, body_cov, rest_cov)
    did = moved[:, None, :3] + moved[:, None, 3:] * turning_velocity(1.0, arm)
    _, then = moves_along(velocity, velocity - did, rest_cov, rest_cov)
    then = np.where(ago[:, None] <= window_s, then, -np.inf)
    return apart, now, then.max(axis=0, initial=-np.inf)


def moves_along(
    velocity: Float64Array, gap: Float64Array, body_cov: Float64Array, rest_cov: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Compare "moves with a body" with "rests" for measured velocities.

    Both likelihoods include their own uncertainty: the more freedom a
    body needs to explain a velocity, the less likely it caused just this one.

    Args:
        velocity: (N, 3) m/s, with covariance ``rest_cov`` (N, 3, 3) about 0 if it rests. gap:
            (..., N, 3) m/s, to what the body does there, with covariance ``body_cov`` (N, 3, 3).

    Returns:
        (..., N) squared Mahalanobis length, and twice the logarithm of the likelihoods' ratio.
    """
    as_body, body_spread = _unlikely(gap, body_cov)
    at_rest, rest_spread = _unlikely(velocity, rest_cov)
    return as_body, at_rest + rest_spread - as_body - body_spread


def _unlikely(gap: Float64Array, cov: Float64Array) -> tuple[Float64Array, Float64Array]:
    """(..., N) squared Mahalanobis length of gaps (..., N, 3), and (N,) the log determinant of cov.

    Their sum is twice the negative logarithm of a normal density, up to a constant.
    """
    squared = np.einsum("...ni,nij,...nj->...n", gap, np.linalg.inv(cov), gap)
    return squared, np.log(np.linalg.det(cov))


def place_on_body(
    origin: Float64Array,
    a0: Float64Array,
    a1: Float64Array,
    a2: Float64Array,
    b0: Float64Array,
    state: Float64Array,
    gained: Float64Array,
    squared_age: Float64Array,
) -> tuple[Float64Array, Float64Array]:
    """Places (N, 3) of points that moved as a body does, with information, see the kernel."""
    cov = np.linalg.inv(a0)
    velocity = np.broadcast_to(state[VELOCITY], origin.shape)
    rate = float(state[YAW_RATE])
    for _ in range(2):
        bend = turning_velocity(rate, velocity)
        inner = b0 - np.einsum("nij,nj->ni", a1, velocity)
        inner -= np.einsum("nij,nj->ni", a2, bend) / 2
        place = origin + np.einsum("nij,nj->ni", cov, inner)
        velocity = state[VELOCITY] + turning_velocity(rate, place - state[POSITION])
    bent = _TURN_DOUBT * abs(rate) * np.linalg.norm(velocity, axis=1)
    doubt = (bent + gained) * squared_age / 2
    return place, np.linalg.inv(cov + (doubt**2)[:, None, None] * np.eye(3))
