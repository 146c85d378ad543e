"""Speed curves: what two recordings of one motion have in common before they are aligned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.errors import TruthError
from observer.geometry import Float64Array
from observer.truth.motion_capture import Trajectory
from observer.truth.speeds import JUMP_STEPS, smoothed_velocity

# Seconds: true and seen speeds are smoothed over the same time, so that ramps look alike.
SMOOTHING_S = 0.4
# Two samples further apart than this many median intervals are the edges of a gap.
GAP_INTERVALS = 3.5
# Seconds: a robot's speed hardly changes in this time, so shorter losses are no gap.
_LOST_S = 0.06
# With an origin 0.2 m from the centre, this turn rate causes a false speed of 0.05 m/s.
_QUICK_TURN_RADPS = 0.25


@dataclass(frozen=True, eq=False)
class SpeedCurve:
    """A speed, or a turn rate, over time.

    Attributes:
        times: (N,) seconds, increasing, of the instants that the values belong to.
        values: (N,) m/s or rad/s, NaN in gaps.
        sigmas: (N,) one standard deviation of each value, same unit; positive.

    Raises:
        TruthError: lengths differ, times do not increase or a sigma is not positive.
    """

    times: Float64Array
    values: Float64Array
    sigmas: Float64Array

    def __post_init__(self) -> None:
        if not self.times.shape == self.values.shape == self.sigmas.shape == (len(self.times),):
            raise TruthError("a speed curve needs one value and one standard deviation per time")
        if not np.isfinite(self.times).all() or (np.diff(self.times) <= 0).any():
            raise TruthError("the times of a speed curve must be finite and increasing")
        if not (self.sigmas > 0).all():
            raise TruthError("the standard deviations of a speed curve must be positive")

    @staticmethod
    def of(times: Float64Array, values: Float64Array, sigma: float = 1.0) -> SpeedCurve:
        """Return a curve with one standard deviation for all values."""
        return SpeedCurve(times, values, np.full(len(times), float(sigma)))

    @property
    def known(self) -> NDArray[np.bool_]:
        """Mask (N,) of the values that are known."""
        return np.asarray(np.isfinite(self.values))

    def at(self, times: Float64Array) -> Float64Array:
        """Return the values (M,) at times (M,) s, interpolated; NaN in gaps and beyond."""
        return between(self.times, self.values[:, None], times)[:, 0]


def between(times: Float64Array, values: Float64Array, wanted: Float64Array) -> Float64Array:
    """Interpolate rows (N, D) at (N,) ascending times linearly at (M,) others; NaN in gaps.

    A gap is a row with NaN, or two times more than 3.5 median intervals apart.
    """
    wanted = np.asarray(wanted, np.float64)
    if len(times) < 2:
        return np.full((len(wanted), values.shape[1]), np.nan)
    intervals = np.diff(times)
    later = np.clip(np.searchsorted(times, wanted, side="right"), 1, len(times) - 1)
    start, step = times[later - 1], intervals[later - 1]
    weight = (wanted - start) / step
    # Exactly at a sample, its neighbour need not be known.
    a, b = values[later - 1], values[later]
    found = a + weight[:, None] * (b - a)
    found = np.where((weight == 0)[:, None], a, found)
    found = np.where((weight == 1)[:, None], b, found)
    outside = (weight < 0) | (weight > 1)
    outside |= (step > GAP_INTERVALS * np.median(intervals)) & (weight > 0) & (weight < 1)
    found[outside] = np.nan
    return np.asarray(found, np.float64)


def window_for(times: Float64Array, seconds: float = SMOOTHING_S) -> int:
    """Return an odd number of samples, at least 5, that spans about this many seconds."""
    if len(times) < 2:
        return 5
    samples = seconds / float(np.median(np.diff(times)))
    return max(5, 2 * round((samples - 1) / 2) + 1)


def body_speed(body: Trajectory) -> SpeedCurve:
    """Return the speed of a motion capture body, smoothed over 0.4 s, where it was seen.

    A few missing samples, as on a lossy network, do not count as a gap here.
    """
    times = body.times[body.seen]
    velocity = smoothed_velocity(
        times,
        body.positions[body.seen],
        window=window_for(times),
        longest_step=longest_loss(times),
    )
    return SpeedCurve.of(times, np.linalg.norm(velocity, axis=1), 0.003)


def longest_loss(times: Float64Array) -> float:
    """Return the longest step of motion capture that is no gap, in median steps."""
    if len(times) < 2:
        return JUMP_STEPS
    return max(JUMP_STEPS, _LOST_S / float(np.median(np.diff(times))))


def steady_speed(body: Trajectory) -> SpeedCurve:
    """Return ``body_speed``, unknown while the body turns quickly.

    Its origin depends on where the markers were put, so it swings about the centre that the
    observer sees. If a body turns most of the time, or has no rotations, all values are kept.
    """
    speed = body_speed(body)
    if body.rotations is None:
        return speed
    rate = turn_rate(*seen_rotations(body), 1.0, longest_loss(speed.times))
    if rate is None or len(rate.times) != len(speed.times):
        return speed
    steady = ~(rate.values > _QUICK_TURN_RADPS)
    if (steady & speed.known).sum() < speed.known.sum() / 2:
        return speed
    return SpeedCurve(speed.times, np.where(steady, speed.values, np.nan), speed.sigmas)


def seen_rotations(body: Trajectory) -> tuple[Float64Array, Float64Array]:
    """Return times (M,) and rotations (M, 3, 3) where the body was seen; it must have rotations."""
    assert body.rotations is not None
    return body.times[body.seen], body.rotations[body.seen]


def turn_rate(
    times: Float64Array, rotations: Float64Array, sigma: float, longest_step: float = JUMP_STEPS
) -> SpeedCurve | None:
    """Return the length of the angular velocity, rad/s, which all points of a body share.

    The rotations' columns c are differentiated like positions; with their rates c' the angular
    velocity is half the sum of c x c'.

    Args:
        rotations: (N, 3, 3), NaN in gaps. sigma: of the result, rad/s.
        longest_step: in median steps; a longer one is a gap.
    """
    if len(times) < 5:
        return None
    window, total = window_for(times), np.zeros((len(times), 3))
    for axis in np.moveaxis(rotations, 2, 0):
        rate = smoothed_velocity(times, axis, window=window, longest_step=longest_step)
        total += np.cross(axis, rate)
    return SpeedCurve.of(times, np.linalg.norm(0.5 * total, axis=1), sigma)
