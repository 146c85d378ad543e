"""Tests whether points move with a body or rest, and places those that join on the body."""

from __future__ import annotations

import math

import numpy as np

from observer.kernels.compiled import REALS1, REALS2, REALS3, Reals, kernel, part
from observer.kernels.small import determinant, inverse_symmetric, squared_length

# Share of a body's speed: a static point beside it may seem to move this fast.
_AT_REST = 0.03
# Share of its speed that a body may gain or lose in a second.
_BRAKING_PER_S = 0.5
# Share of a body's yaw rate by which it may have differed since a point was first seen.
_TURN_DOUBT = 0.5
# Keeps information invertible, (m/s)^-2.
_LEAST_INFORMATION = 1e-6


@part
def _log_determinant(A: Reals) -> float:
    """Return ln det A (3, 3), symmetric; NaN where that is not positive."""
    det = determinant(A)
    return math.log(det) if det > 0.0 else np.nan


@part
def _compare(
    velocity: Reals, gap: Reals, body_cov: Reals, rest_cov: Reals, inverse: Reals
) -> tuple[float, float]:
    """Return the squared length of a gap, and the likelihood ratio, as ``moves_along`` does.

    Args:
        inverse: (3, 3) is written: of ``rest_cov``.
    """
    inverse_symmetric(body_cov, inverse)
    as_body = squared_length(gap, inverse)
    inverse_symmetric(rest_cov, inverse)
    at_rest = squared_length(velocity, inverse)
    more = _log_determinant(rest_cov) - _log_determinant(body_cov)
    return as_body, at_rest - as_body + more


@kernel(REALS1, REALS1, REALS2, REALS2)
def moves_along(
    velocity: Reals, gap: Reals, body_cov: Reals, rest_cov: Reals
) -> tuple[float, float]:
    """Compare the hypotheses "moves with a body" and "rests" for one observed velocity.

    Likelihoods include all uncertainties of either hypothesis: the larger the body's covariance,
    the less likely it is to produce exactly this velocity.

    Args:
        velocity: (3,) m/s, with covariance ``rest_cov`` (3, 3) about 0 if it rests. gap: (3,) m/s,
            to the body's velocity there, with covariance ``body_cov`` (3, 3).

    Returns:
        Squared Mahalanobis length of the gap, and twice the logarithm of the likelihood ratio.
    """
    return _compare(velocity, gap, body_cov, rest_cov, np.empty((3, 3)))


@kernel(REALS2, REALS3, REALS3, REALS1, REALS2, REALS1, REALS1, REALS2)
def against_rest(
    velocity: Reals, information: Reals, shared_cov: Reals, window_s: Reals, place: Reals,
    state: Reals, ago: Reals, moved: Reals,
) -> tuple[Reals, Reals, Reals]:  # fmt: skip
    """Compare "moves with a body" with "rests" for N points, as ``moves_along`` does.

    Args:
        velocity: (N, 3) m/s, world, the points' own, with information (N, 3, 3), over window_s
            (N,). shared_cov: (N, 3, 3) (m/s)^2, from errors that all points share. place: (N, 3)
            metres, world. state: (8,) of the body, see ``BodyFilter``.
        ago: (T,) seconds before now, at which the body moved at moved (T, 4) m/s and rad/s.

    Returns:
        (N,) each: the squared length of the velocity's gap to the body's there now; twice the log
        of its likelihood ratio; and the largest such value, without determinants, of all instants
        within the points' windows.
    """
    count = len(velocity)
    apart, now, then = np.empty(count), np.empty(count), np.empty(count)
    body_cov, rest_cov, inverse, gap = (
        np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty(3),
    )  # fmt: skip
    speed = math.sqrt(state[3] ** 2 + state[4] ** 2 + state[5] ** 2)
    changes = speed * (abs(state[7]) + _BRAKING_PER_S)
    slow = (_AT_REST * speed) ** 2
    for i in range(count):
        for j in range(3):
            for k in range(3):
                rest_cov[j, k] = information[i, j, k]
            rest_cov[j, j] += _LEAST_INFORMATION
        inverse_symmetric(rest_cov, body_cov)
        # A point's velocity is the mean over its window; a turning or braking body has changed its
        # velocity since.
        lag = changes * window_s[i] / 2.0
        for j in range(3):
            for k in range(3):
                rest_cov[j, k] = body_cov[j, k] + shared_cov[i, j, k]
            rest_cov[j, j] += slow
            body_cov[j, j] += lag * lag
        x, z = place[i, 0] - state[0], place[i, 2] - state[2]
        gap[0] = velocity[i, 0] - (state[3] + state[7] * z)
        gap[1] = velocity[i, 1] - state[4]
        gap[2] = velocity[i, 2] - (state[5] - state[7] * x)
        apart[i], now[i] = _compare(velocity[i], gap, body_cov, rest_cov, inverse)
        then[i] = -np.inf
        at_rest = squared_length(velocity[i], inverse)
        for t in range(len(ago)):
            if ago[t] <= window_s[i]:
                gap[0] = velocity[i, 0] - (moved[t, 0] + moved[t, 3] * z)
                gap[1] = velocity[i, 1] - moved[t, 1]
                gap[2] = velocity[i, 2] - (moved[t, 2] - moved[t, 3] * x)
                then[i] = max(then[i], at_rest - squared_length(gap, inverse))
    return apart, now, then


@kernel(
    REALS2, REALS3, REALS3, REALS3, REALS2, REALS1, REALS1, REALS1
)  # fmt: skip
def place_on_body(
    origin: Reals, a0: Reals, a1: Reals, a2: Reals, b0: Reals,
    state: Reals, gained: Reals, squared_age: Reals,
) -> tuple[Reals, Reals]:  # fmt: skip
    """Return places (N, 3) m, world, of points that moved as a body does, with information.

    The model of their sightings is ``z = p + v s + a s^2 / 2`` with the velocity v and the
    acceleration a that the turning body has there.

    Args:
        origin ... b0: sums of ``PositionVelocityFilter``. state: (8,) of the body, see
            ``BodyFilter``. gained: (N,) m/s^2, by which it sped up or braked over their ages.
            squared_age: (N,) s^2, mean squared age of their sightings.
    """
    count, rate = len(origin), state[7]
    place, information = np.empty((count, 3)), np.empty((count, 3, 3))
    cov, inner = np.empty((3, 3)), np.empty(3)
    for i in range(count):
        inverse_symmetric(a0[i], cov)
        vx, vy, vz = state[3], state[4], state[5]
        # First with the velocity of the body's origin, then with that at the point's place.
        for _ in range(2):
            for j in range(3):
                inner[j] = (
                    b0[i, j]
                    - (a1[i, j, 0] * vx + a1[i, j, 1] * vy + a1[i, j, 2] * vz)
                    - rate * (a2[i, j, 0] * vz - a2[i, j, 2] * vx) / 2.0
                )
            for j in range(3):
                place[i, j] = origin[i, j]
                for k in range(3):
                    place[i, j] += cov[j, k] * inner[k]
            vx = state[3] + rate * (place[i, 2] - state[2])
            vz = state[5] - rate * (place[i, 0] - state[0])
        # The yaw rate may have been different over that time.
        bent = _TURN_DOUBT * abs(rate) * math.sqrt(vx * vx + vy * vy + vz * vz)
        doubt = (bent + gained[i]) * squared_age[i] / 2.0
        for j in range(3):
            cov[j, j] += doubt * doubt
        inverse_symmetric(cov, information[i])
    return place, information
