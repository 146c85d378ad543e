"""Candidate paths of a differential-drive robot over the next seconds."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from observer.geometry import Float64Array
from observer.guard.parameters import GuardParameters

# Index of the path on which the robot stops.
STANDING: Final = 0
# Turn rate per radian of heading error, 1/s.
_STEERING: Final = 1.0
# Directions tried, relative to that to the goal, radians; and how long each is held before turning
# back to the goal, seconds.
_ASIDE: Final = np.radians([0, 12, -12, 25, -25, 45, -45, 70, -70])
_HELD_S: Final = (1.2, 2.8)
# Share of the full deceleration used to stop at the goal.
_GENTLY: Final = 0.5
# Speeds tried, as shares of the highest speed.
_SPEEDS: Final = (1.0, 0.6, 0.25)


@dataclass(frozen=True)
class Motion:
    """A robot now: x, y metres and yaw in a fixed frame; m/s forward, rad/s to the left."""

    x: float
    y: float
    yaw: float
    speed_mps: float
    turn_rate_radps: float


@dataclass(frozen=True, eq=False)
class Rollouts:
    """C paths (*ways*) at K instants.

    Attributes:
        times: (K,) seconds from now. poses: (C, K, 3) x, y, yaw. speed, turn: (C, K) m/s, rad/s.
        asked: (C, 2) m/s and rad/s to ask of the robot now, which it reaches as fast as it can.
    """

    times: Float64Array
    poses: Float64Array
    speed: Float64Array
    turn: Float64Array
    asked: Float64Array

    def only(self, way: int) -> Rollouts:
        """Return one of the ways."""
        one = slice(way, way + 1)
        return replace(
            self,
            poses=self.poses[one],
            speed=self.speed[one],
            turn=self.turn[one],
            asked=self.asked[one],
        )

    def driven_m(self) -> Float64Array:
        """(C,) metres driven."""
        return np.asarray(np.abs(self.speed).sum(axis=1) * (self.times[1] - self.times[0]))


def rollouts(
    now: Motion,
    bearing: float,
    left_m: float,
    times: Float64Array,
    limits: GuardParameters,
) -> Rollouts:
    """Return the ways to choose from; the first one stops, and the next goes straight ahead.

    Each heads to one side of the bearing for a while and then along it; speed and turn rate change
    no faster than the robot's limits allow.

    Args:
        bearing: direction to drive in, radians in the frame of ``now``.
        left_m: distance to the goal, at which every way ends.
        times: (K,) seconds from now, evenly spaced, the first one after one step.
    """
    asked = [(0.0, 0.0, 0.0)]
    asked += [
        (share * limits.speed_max_mps, aside, held)
        for share in _SPEEDS
        for held in _HELD_S
        for aside in (_ASIDE if held == _HELD_S[0] else _ASIDE[1:])
    ]
    wanted, aside, held = np.array(asked).T
    dt = float(times[0])
    pose = np.tile([now.x, now.y, now.yaw], (len(wanted), 1))
    speed = np.full(len(wanted), now.speed_mps)
    turn = np.full(len(wanted), now.turn_rate_radps)
    left = np.full(len(wanted), left_m)
    slower, faster = limits.deceleration_mps2 * dt, limits.acceleration_mps2 * dt
    most, step = limits.turn_rate_max_radps, limits.turn_acceleration_radps2 * dt
    poses, speeds, turns, targets = [], [], [], []
    for time in times - dt:
        error = wrapped(bearing + np.where(time < held, aside, 0.0) - pose[:, 2])
        ending = np.sqrt(2 * _GENTLY * limits.deceleration_mps2 * np.maximum(left, 0.0))
        # Slow down to turn rather than drive a wide bend.
        target = np.minimum(wanted, ending) * np.maximum(np.cos(error), 0.0)
        rate = np.where(wanted > 0, np.clip(_STEERING * error, -most, most), 0.0)
        speed = speed + np.clip(target - speed, -slower, faster)
        turn = turn + np.clip(rate - turn, -step, step)
        pose = _moved(pose, speed, turn, dt)
        left = left - speed * dt
        poses.append(pose)
        speeds.append(speed)
        turns.append(turn)
        targets.append(np.stack([target, rate], axis=1))
    return Rollouts(times, np.stack(poses, 1), np.stack(speeds, 1), np.stack(turns, 1), targets[0])


def braked(ways: Rollouts, reaction: int, limits: GuardParameters) -> Rollouts:
    """Return the same ways, each braked to a standstill after the first ``reaction`` instants."""
    dt = float(ways.times[1] - ways.times[0])
    poses, speed, turn = ways.poses.copy(), ways.speed.copy(), ways.turn.copy()
    for k in range(reaction, len(ways.times)):
        before = speed[:, k - 1]
        speed[:, k] = np.maximum(np.abs(before) - limits.deceleration_mps2 * dt, 0.0)
        share = np.divide(speed[:, k], before, out=np.zeros_like(before), where=before > 0)
        turn[:, k] = turn[:, k - 1] * share
        poses[:, k] = _moved(poses[:, k - 1], speed[:, k], turn[:, k], dt)
    return replace(ways, poses=poses, speed=speed, turn=turn)


def _moved(pose: Float64Array, speed: Float64Array, turn: Float64Array, dt: float) -> Float64Array:
    middle = pose[:, 2] + turn * dt / 2
    distance = speed * dt
    x = pose[:, 0] + distance * np.cos(middle)
    y = pose[:, 1] + distance * np.sin(middle)
    return np.stack([x, y, pose[:, 2] + turn * dt], axis=1)


def wrapped(angle: Float64Array) -> Float64Array:
    """Angles between -pi and pi."""
    return np.asarray((angle + math.pi) % (2 * math.pi) - math.pi)
