"""Places where tracked people may be over the next seconds.

A person goes on, stops, or turns to either side. Each of these manoeuvres is a Gaussian that
widens with the track's own uncertainty and with the accelerations of walking people, who return to
the manoeuvre's velocity after each: an Ornstein-Uhlenbeck process. Together the manoeuvres form a
mixture, weighted by what that person did so far: the multiple-model estimate of Blom and Bar-Shalom
(The interacting multiple model algorithm, IEEE TAC 33, 1988). Only the weights are kept from frame
to frame, as position and velocity come from the tracker.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from observer.geometry import Float64Array
from observer.guard.sight import SeenObstacle

# A stopping person halves its speed in this time; a turning one turns at this rate, for this long.
_STOPPING_S: Final = 0.35
_TURN_RADPS, _TURNING_S = 0.9, 1.2
# Time constant with which a deviation of the velocity from a manoeuvre's subsides.
_SETTLING_S: Final = 4.0
# Standard deviations assumed where the tracker reports none.
_UNKNOWN_POSITION_M: Final = 0.2
_UNKNOWN_VELOCITY_MPS: Final = 0.3
# Lower bound of the spread, by which distances are divided.
_LEAST_SIGMA_M: Final = 1e-3


@dataclass(frozen=True, eq=False)
class Futures:
    """N people at K instants, each a mixture of M Gaussians of equal spread in all directions.

    Attributes:
        ids: (N,) numbers of their tracks. radius: (N,) metres, of a circle that encloses the body.
        times: (K,) seconds from now.
        mean: (N, M, K, 2) metres. sigma: (N, M, K) metres, one standard deviation.
        weight: (N, M) probability of each Gaussian.
    """

    ids: tuple[int, ...]
    radius: Float64Array
    times: Float64Array
    mean: Float64Array
    sigma: Float64Array
    weight: Float64Array

    def __len__(self) -> int:
        return len(self.ids)


def futures(
    people: Sequence[SeenObstacle],
    weights: Float64Array,
    times: Float64Array,
    acceleration_noise: float,
    since: Sequence[float] | None = None,
) -> Futures:
    """Return where people may be, in the frame in which they are given.

    Args:
        people: N tracks as last seen, in a fixed frame. weights: (N, M) as from ``Habits``.
        times: (K,) seconds from now.
        acceleration_noise: within one manoeuvre, m/s^2 in a band of 1 Hz.
        since: seconds since each person was seen, whose manoeuvre began then; zero if None.
    """
    if not people:
        empty = np.zeros((*weights.shape, len(times)))
        return Futures((), np.zeros(0), times, np.zeros((*empty.shape, 2)), empty, weights)
    place = np.array([(one.x, one.y) for one in people])
    velocity = np.array([(one.vx, one.vy) for one in people])
    passed = times + np.zeros((len(people), 1)) if since is None else times + np.c_[list(since)]
    mean = place[:, None, None] + displaced(velocity, passed)
    spread = np.stack(
        [spread_of(*each, acceleration_noise) for each in zip(people, passed, strict=True)]
    )
    return Futures(
        ids=tuple(one.id for one in people),
        radius=np.array([one.radius_m for one in people]),
        times=times,
        mean=mean,
        sigma=np.broadcast_to(spread[:, None], mean.shape[:3]),
        weight=weights,
    )


def spread_of(one: SeenObstacle, times: Float64Array, acceleration_noise: float) -> Float64Array:
    """(K,) standard deviations of a person's place, metres, at times (K,) since it was seen."""
    sigma_p = _UNKNOWN_POSITION_M if one.position_sigma_m is None else one.position_sigma_m
    sigma_v = _UNKNOWN_VELOCITY_MPS if one.velocity_sigma_mps is None else one.velocity_sigma_mps
    # The position variance of a velocity that starts from its mean; at first times^3 / 3.
    x = times / _SETTLING_S
    wanders = _SETTLING_S**3 * (x - 2 * (1 - np.exp(-x)) + (1 - np.exp(-2 * x)) / 2)
    variance = sigma_p**2 + (sigma_v * times) ** 2 + acceleration_noise**2 * wanders
    return np.asarray(np.sqrt(_LEAST_SIGMA_M**2 + variance))


def displaced(velocity: Float64Array, times: Float64Array) -> Float64Array:
    """(N, M, K, 2) displacements, metres, by manoeuvre.

    Args:
        velocity: (N, 2) m/s at its beginning. times: (K,) or (N, K) seconds since then.
    """
    vx, vy = velocity[:, :1], velocity[:, 1:]
    stopping = _STOPPING_S / np.log(2)
    straight = (times, np.zeros_like(times))
    braked = (stopping * (1 - np.exp(-times / stopping)), np.zeros_like(times))
    turning = np.minimum(times, _TURNING_S)
    after = times - turning
    angle = _TURN_RADPS * turning
    along = np.sin(angle) / _TURN_RADPS + after * np.cos(angle)
    across = (1 - np.cos(angle)) / _TURN_RADPS + after * np.sin(angle)
    ways = (straight, braked, (along, across), (along, -across))
    x = np.stack([vx * a - vy * b for a, b in ways], axis=1)
    y = np.stack([vy * a + vx * b for a, b in ways], axis=1)
    return np.stack([x, y], axis=-1)
