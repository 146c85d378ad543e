"""Intruders: objects that sonar hears approaching by themselves, also where no camera looks.

An echo gives a distance, but not where across the cone. So a static object explains a new echo
unless every place on its arc was reported clear a moment ago, by this sonar's earlier readings or
by another's, carried along by odometry. Driving past boxes and through doors brings new ground
into the cone at its leading edge, and the echo may jump nearer; a moving object approaches over
ground that was clear, in steps that fit a speed, reading by reading.

Such an object is predicted from several places across the cone: once at constant bearing, which
is how two bodies collide, and once straight along the cone. The standard deviations used are those
of the range, of the rate at which it falls, and of the cone's width.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from observer.geometry import Float64Array
from observer.guard.dead_reckoning import DeadReckoning
from observer.guard.parameters import GuardParameters
from observer.guard.sight import SeenObstacle
from observer.guard.sonar_clear import sonar_rows
from observer.robots.contract import SonarReading

# How long ground that was clear is evidence that no static object is there.
_MEMORY_S = 4.0
# A range has about 1 cm of noise, and a packet reports it up to 0.1 s after it was taken.
_RANGE_SIGMA_M = 0.015
_TOLERANCE_M = 0.04
_DELAY_S = 0.05
# Error of the odometry, as a share of the distance driven since.
_DRIFT = 0.05
# An echo where there already was one this long ago comes from a static object.
_STATIC_S = 0.45
# Two echoes further apart in time are not compared.
_LONGEST_GAP_S = 0.8
# Readings of one sonar at shorter intervals add no information.
_APART_S = 0.1
# Range of approach speeds over ground, besides the robot's own speed.
_FASTEST_MPS = 1.5
_SLOWEST_MPS = 0.05
# Share of an echo's arc that must have been clear for it to come from a moving object, and the
# share that suffices while that goes on approaching.
_CLEAR_SHARE = 0.8
_STILL_CLEAR_SHARE = 0.4
_ARC = 7
# Farther away a cone is too wide to tell what moves.
_FARTHEST_M = 1.5
_DEGREE = math.radians(1.0)
# Share of the half angle within which an object surely echoes, wherever in the cone it is now.
_SURE_SHARE = 0.67
_ACROSS = (-0.67, 0.0, 0.67)


@dataclass(frozen=True)
class _Heard:
    """An echo, in the odometry's axes.

    Attributes:
        x, y, heading: of the sonar. comes: whether something approaches by itself.
    """

    received: float
    x: float
    y: float
    heading: float
    range_m: float
    comes: bool


class SonarWatch:
    """Follows each sonar's echoes and tells which come from approaching objects."""

    def __init__(self) -> None:
        # Columns: received, x, y, heading, range (infinite where nothing echoed), clear up to.
        self._readings: deque[tuple[float, ...]] = deque(maxlen=256)
        self._newest: dict[int, tuple[float, float]] = {}
        self._trails: dict[int, deque[_Heard]] = {}
        self._doubted: dict[int, _Heard] = {}

    def forget(self) -> None:
        """Forget all readings: where the robot was before is unknown."""
        self._readings.clear()
        self._newest.clear()
        self._trails.clear()
        self._doubted.clear()

    def listen(
        self, sonars: Sequence[SonarReading], now: float, past: DeadReckoning, p: GuardParameters
    ) -> None:
        """Take in the readings that are new since the last call."""
        new = [one for one in sonars if self._is_new(one, now, p)]
        if not new:
            return
        rows = sonar_rows(new)
        poses = past.poses(rows[:, 0])
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        x = poses[:, 0] + c * rows[:, 1] - s * rows[:, 2]
        y = poses[:, 1] + s * rows[:, 1] + c * rows[:, 2]
        rows[:, 1], rows[:, 2], rows[:, 3] = x, y, poses[:, 2] + rows[:, 3]
        shares = np.zeros(len(new))
        nearer = [self._may_come(one.index, one.range_m, p) for one in new]
        if any(nearer):
            shares[nearer] = self._come_in(rows[nearer], p)
        for one, row, share in zip(new, rows.tolist(), shares.tolist(), strict=True):
            # Echoes are missed now and then: one reading alone does not prove ground clear.
            _, before = self._newest.get(one.index, (0.0, 0.0))
            self._newest[one.index] = one.received, row[4]
            self._readings.append((*row, min(row[4], before)))
            self._follow(one.index, row, share, p)

    def _is_new(self, one: SonarReading, now: float, p: GuardParameters) -> bool:
        before, _ = self._newest.get(one.index, (-math.inf, 0.0))
        return one.received - before >= _APART_S and now - one.received <= p.sonar_fresh_s

    def _may_come(self, index: int, range_m: float | None, p: GuardParameters) -> bool:
        """Return whether it is nearer than the echo it may continue; others need no check."""
        if range_m is None or range_m > min(_FARTHEST_M, p.sonar_reach_m):
            return False
        trail, doubted = self._trails.get(index), self._doubted.get(index)
        return bool(trail and trail[-1].range_m > range_m) or (
            doubted is not None and doubted.range_m > range_m
        )

    def _come_in(self, rows: Float64Array, p: GuardParameters) -> Float64Array:
        """(M,) share of each echo's arc that was clear before, with no static object there."""
        while self._readings and rows[0, 0] - self._readings[0][0] > _MEMORY_S:
            self._readings.popleft()
        if not self._readings:
            return np.zeros(len(rows))
        received, x, y, heading, echo, free = np.array(self._readings).T
        half = math.radians(p.sonar_half_angle_deg)
        off = np.linspace(-half, half, _ARC)
        angle = rows[:, 3, None] + off
        # (M, K, J): new echo, place on its arc, earlier reading.
        dx = (rows[:, 1, None] + rows[:, 4, None] * np.cos(angle))[..., None] - x
        dy = (rows[:, 2, None] + rows[:, 4, None] * np.sin(angle))[..., None] - y
        distance = np.sqrt(dx * dx + dy * dy)
        c, s = np.cos(heading), np.sin(heading)
        along, aside = c * dx + s * dy, np.abs(c * dy - s * dx)
        age = (rows[:, 0, None] - received)[:, None, :]
        # An object that echoes this far off the axis now would have echoed there before.
        surely = np.tan(np.maximum(np.abs(off) + _DEGREE, _SURE_SHARE * half))[:, None]
        reach = np.minimum(free, p.sonar_reach_m)
        driven = np.hypot(rows[:, 1, None] - x, rows[:, 2, None] - y)
        tolerance = (_TOLERANCE_M + _DRIFT * driven)[:, None, :]
        clear = (aside <= along * surely) & (distance < reach - tolerance) & (age > 0)
        static = (
            (aside <= along * math.tan(half + 3 * _DEGREE))
            & (np.abs(distance - echo) <= tolerance)
            & (age >= _STATIC_S)
        )
        moved_in = clear.any(axis=2) & ~static.any(axis=2)
        return np.asarray(moved_in.mean(axis=1))

    def _follow(self, index: int, row: list[float], share: float, p: GuardParameters) -> None:
        """Continue a sonar's trail with its new reading, or begin another one."""
        received, x, y, heading, echo = row
        trail = self._trails.setdefault(index, deque(maxlen=4))
        doubted = self._doubted.pop(index, None)
        new = _Heard(received, x, y, heading, echo, comes=False)
        if trail and received - trail[-1].received > _LONGEST_GAP_S:
            trail.clear()
        if trail and not _follows(trail[-1], new, p):
            if doubted is None:
                # An outlier or another object: a second reading has to confirm the latter.
                self._doubted[index] = new
                return
            trail.clear()
            if _follows(doubted, new, p):
                trail.append(doubted)
        comes = bool(trail) and _comes(trail[-1], new, share)
        if not comes:
            # The rate is measured since the approach began.
            trail.clear()
        if echo <= p.sonar_reach_m:
            trail.append(replace(new, comes=comes))

    def coming(
        self, now: float, past: DeadReckoning, p: GuardParameters
    ) -> list[tuple[int, list[SeenObstacle]]]:
        """Return what approaches: sonar number and predicted places, in the current base frame."""
        return [
            (index, _predicted(index, trail, now, past, p))
            for index, trail in self._trails.items()
            if trail and trail[-1].comes and now - trail[-1].received <= p.sonar_fresh_s
        ]


def _follows(last: _Heard, new: _Heard, p: GuardParameters) -> bool:
    """Return whether the same object may have echoed twice: its range does not jump."""
    gap = new.received - last.received
    own = math.hypot(new.x - last.x, new.y - last.y)
    most = _FASTEST_MPS * (gap + _DELAY_S) + own
    return new.range_m <= p.sonar_reach_m and abs(last.range_m - new.range_m) <= most


def _comes(last: _Heard, new: _Heard, share: float) -> bool:
    """Return whether the echo came nearer and enough of its arc (``share``) was clear before."""
    if last.range_m - new.range_m <= _SLOWEST_MPS * (new.received - last.received):
        return False
    return share >= (_STILL_CLEAR_SHARE if last.comes else _CLEAR_SHARE)


def _predicted(
    index: int, trail: Sequence[_Heard], now: float, past: DeadReckoning, p: GuardParameters
) -> list[SeenObstacle]:
    first, last = trail[0], trail[-1]
    gap, age = last.received - first.received, now - last.received
    rate = (first.range_m - last.range_m) / gap
    rate_sigma = math.hypot(math.sqrt(2) * _RANGE_SIGMA_M, rate * _DELAY_S) / gap
    own_x, own_y = (last.x - first.x) / gap, (last.y - first.y) / gap
    half = math.radians(p.sonar_half_angle_deg)
    place_sigma = math.hypot(_RANGE_SIGMA_M, last.range_m * half * 0.3)
    x0, y0, yaw = past.poses(np.array([now]))[0].tolist()
    c0, s0 = math.cos(yaw), math.sin(yaw)
    found = []
    for share in _ACROSS:
        c, s = math.cos(last.heading + share * half), math.sin(last.heading + share * half)
        along = own_x * c + own_y * s
        for across in (own_y * c - own_x * s, 0.0):
            vx, vy = (along - rate) * c - across * s, (along - rate) * s + across * c
            dx = last.x + last.range_m * c + vx * age - x0
            dy = last.y + last.range_m * s + vy * age - y0
            place = c0 * dx + s0 * dy, c0 * dy - s0 * dx
            velocity = c0 * vx + s0 * vy, c0 * vy - s0 * vx
            sigma = math.hypot(place_sigma, rate_sigma * age)
            found.append(SeenObstacle(index, *place, *velocity, 0.0, sigma, rate_sigma, False))
    return found
