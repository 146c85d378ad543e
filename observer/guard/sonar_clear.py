"""Classification of ground by fresh sonar readings: clear, echoing or neither."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.guard.dead_reckoning import DeadReckoning
from observer.guard.parameters import GuardParameters
from observer.robots.contract import SonarReading

# Highest error of an echo's range.
_RANGE_ERROR_M = 0.04
# A sonar is blind to the side of its own face; its neighbour covers what is level with it.
_BEHIND_FACE_M = 0.08
# A reading may arrive during the tick: by at most this much later than the tick's ``now``.
_SINCE_S = 0.1
# Cosine: sonars that point further aside, from 60 degrees on, do not face a motion.
_FACING = 0.5


@dataclass(frozen=True, eq=False)
class SonarView:
    """Fresh readings, carried to the robot's current pose.

    Attributes:
        index: (S,) their numbers. x, y, heading: (S,) of each sonar at its reading, in the
            current base frame. echo_m: (S,) range of the echo, infinite where none came.
        clear_m: (S,) how far its cone still counts as clear.
    """

    index: tuple[int, ...]
    x: Float64Array
    y: Float64Array
    heading: Float64Array
    echo_m: Float64Array
    clear_m: Float64Array


def sonar_rows(sonars: Sequence[SonarReading]) -> Float64Array:
    """Return rows (S, 5) of received, x, y, heading and range, infinite without an echo."""
    return np.array(
        [
            (s.received, s.x, s.y, s.heading, math.inf if s.range_m is None else s.range_m)
            for s in sonars
        ]
    )


def fresh_sonar(
    sonars: Sequence[SonarReading], now: float, past: DeadReckoning, p: GuardParameters
) -> SonarView | None:
    """Return the readings that still count; None where there are none.

    A reading's clear range shrinks with its age, by ``intruder_mps``.
    """
    fresh = [one for one in sonars if _is_fresh(one, now, p)]
    if not fresh:
        return None
    received, x, y, heading, echo = sonar_rows(fresh).T
    # The current base in the base frame of each reading; here its inverse is needed.
    dx, dy, yaw = past.then_from_now(received).T
    c, s = np.cos(yaw), np.sin(yaw)
    rx, ry = x - dx, y - dy
    reach = np.minimum(echo - _RANGE_ERROR_M, p.sonar_reach_m)
    return SonarView(
        tuple(one.index for one in fresh),
        c * rx + s * ry,
        c * ry - s * rx,
        heading - yaw,
        echo,
        reach - p.intruder_mps * np.maximum(now - received, 0.0),
    )


def is_silent(
    sonars: Sequence[SonarReading], direction: float, now: float, p: GuardParameters
) -> bool:
    """Return whether a robot has sonars, but none that faces a motion has a fresh reading.

    Where none faces it, all count. A robot without readings, even outdated ones, has no sonars.

    Args:
        direction: of the motion, positive forward.
    """
    sign = math.copysign(1.0, direction)
    facing = [one for one in sonars if sign * math.cos(one.heading) >= _FACING] or sonars
    return bool(facing) and not any(_is_fresh(one, now, p) for one in facing)


def _is_fresh(one: SonarReading, now: float, p: GuardParameters) -> bool:
    return -_SINCE_S <= now - one.received <= p.sonar_fresh_s


def clear_by_sonar(points: Float64Array, view: SonarView, p: GuardParameters) -> NDArray[np.bool_]:
    """Return which points (N, 2) of the base frame lie on ground that is clear by sonar.

    In a clear cone, or between two clear cones whose gap there is at most ``thing_width_m``: any
    obstacle in it reaches into one of them.
    """
    along, aside, distance = _local(points, view)
    half = math.radians(p.sonar_half_angle_deg)
    valid = (distance <= view.clear_m[:, None]) & (along >= -_BEHIND_FACE_M)
    off_cone = np.maximum(np.abs(aside) * math.cos(half) - along * math.sin(half), 0.0)
    gap = np.where(valid, off_cone, np.inf)
    left = np.where(aside >= 0, gap, np.inf).min(axis=0)
    right = np.where(aside <= 0, gap, np.inf).min(axis=0)
    inside = np.minimum(left, right) <= 0
    between = left + right <= p.thing_width_m
    # An object that echoes there may be narrow enough to fit the gap.
    echoed = (off_cone <= 0) & (distance >= view.echo_m[:, None] - _RANGE_ERROR_M)
    return np.asarray(inside | (between & ~echoed.any(axis=0)), np.bool_)


def echo_at(points: Float64Array, view: SonarView, p: GuardParameters) -> NDArray[np.bool_]:
    """(S, N) whether points (N, 2) of the base frame may be where the echo arose, or behind it.

    An echo does not tell where in the cone it arose, so it may be anywhere across.
    """
    along, aside, distance = _local(points, view)
    half = math.radians(p.sonar_half_angle_deg)
    inside = (along > 0) & (np.abs(aside) <= along * math.tan(half))
    return np.asarray(inside & (distance >= view.echo_m[:, None] - _RANGE_ERROR_M), np.bool_)


def _local(
    points: Float64Array, view: SonarView
) -> tuple[Float64Array, Float64Array, Float64Array]:
    dx = points[:, 0] - view.x[:, None]
    dy = points[:, 1] - view.y[:, None]
    c, s = np.cos(view.heading)[:, None], np.sin(view.heading)[:, None]
    return c * dx + s * dy, c * dy - s * dx, np.hypot(dx, dy)
