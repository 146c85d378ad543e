"""Perception of a robot in a crowd: tracks with the observer's errors, free floor, echoes.

Rendering images would take minutes per metre, so the observer is replaced by a model of its errors
as measured on the people of the simulated lab (see the documentation, Accuracy).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from observer.evaluation.navigation.crowd import People, Room
from observer.geometry import Float64Array
from observer.guard.seeing import LEAST_RADIUS_M
from observer.guard.sight import FreeScan, SeenObstacle, Sight
from observer.navigation.rollouts import wrapped
from observer.robots.contract import SonarReading
from observer.robots.models import SonarPose
from observer.types import Status

WORLD: Final = "crowd"
# The simulated camera's view, from the robot's base. Nearer than this only legs are in view, which
# the tracker does not report as an obstacle.
_HALF_VIEW_RAD: Final = math.radians(30)
_NEAREST_M, _FARTHEST_M = 0.9, 6.0
_FLOOR_FROM_M, _FLOOR_TO_M = 1.0, 5.0
# The observer's figures: recall, delay of the first report, coasting time; one standard deviation
# of its errors in each direction, and their correlation time.
_RECALL, _DELAY_S, _COAST_S = 0.96, 0.4, 0.6
_POSITION_M, _VELOCITY_MPS, _LASTING_S = 0.06, 0.1, 0.4
# Time between two frames, and from a frame's exposure until the plan made from it is driven.
FRAME_S: Final = 0.1
LATENCY_S: Final = 0.1
_BEARINGS: Final = np.radians(np.arange(-30.0, 30.1, 3.0))
_SONAR_HALF_RAD, _SONAR_REACH_M = math.radians(15), 3.0
# Seconds between two sonars of an array, and number of sonars in an array.
_SONAR_EVERY_S, _ARRAY = 0.04, 8


class _Track:
    def __init__(self, since: float) -> None:
        self.since = self.seen = since
        self.error = np.zeros(4)
        self.place = np.zeros(4)


class ModelledPerception:
    """Perception of one robot; a person becomes a track after being in view for long enough."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng([seed, 1])
        self._tracks: dict[int, _Track] = {}
        self._frame = 0

    def look(self, people: People, pose: Float64Array, room: Room, time: float) -> Sight:
        """Return the sight of people from a pose (3,), of a frame received at ``time``."""
        seen = list(self._seen(people, in_view(people, pose), pose, time))
        self._frame += 1
        return Sight(
            frame=self._frame,
            received=time,
            published=time,
            world=WORLD,
            status=Status.OK,
            reasons=(),
            mount_known=True,
            obstacles=tuple(seen),
            scan=_scan(people, pose, room),
        )

    def _seen(
        self, people: People, visible: NDArray[np.bool_], pose: Float64Array, time: float
    ) -> Iterator[SeenObstacle]:
        for k, number in enumerate(people.number.tolist()):
            track = self._tracks.get(number)
            if track is not None and time - track.seen > _COAST_S:
                track = None
                del self._tracks[number]
            if visible[k] and track is None:
                track = self._tracks[number] = _Track(time)
            if track is None:
                continue
            coasting = not visible[k] or (time > track.since and bool(self._rng.random() > _RECALL))
            if coasting:
                now = track.place.copy()
                now[:2] += now[2:] * (time - track.seen)
            else:
                now = np.r_[people.position[k], people.velocity[k]] + self._error(track, time)
                track.place, track.seen = now, time
            if track.seen - track.since < _DELAY_S - 1e-9:
                continue
            x, y = turned(now[:2] - pose[:2], -pose[2]).tolist()
            vx, vy = turned(now[2:], -pose[2]).tolist()
            yield SeenObstacle(
                id=number,
                x=x,
                y=y,
                vx=vx,
                vy=vy,
                radius_m=max(LEAST_RADIUS_M, float(people.radius_m[k])),
                position_sigma_m=_POSITION_M,
                velocity_sigma_mps=_VELOCITY_MPS,
                coasting=coasting,
            )

    def _error(self, track: _Track, time: float) -> Float64Array:
        """(4,) errors of position and velocity: a Gauss-Markov process, like a filter's errors."""
        kept = 0.0 if time == track.since else math.exp(-(time - track.seen) / _LASTING_S)
        sigma = np.repeat([_POSITION_M, _VELOCITY_MPS], 2)
        noise = self._rng.normal(size=4) * sigma
        track.error = kept * track.error + math.sqrt(1 - kept**2) * noise
        return track.error


def in_view(people: People, pose: Float64Array) -> NDArray[np.bool_]:
    """(N,) whether each person is in the camera's view and not hidden behind somebody."""
    away = people.position - pose[:2]
    distance = np.hypot(away[:, 0], away[:, 1])
    bearing = np.arctan2(away[:, 1], away[:, 0]) - pose[2]
    bearing = wrapped(bearing)
    visible = (np.abs(bearing) < _HALF_VIEW_RAD) & (distance < _FARTHEST_M)
    visible &= distance > _NEAREST_M
    half = np.arcsin(np.minimum(people.radius_m / np.maximum(distance, 1e-6), 1.0))
    apart = np.abs(bearing[:, None] - bearing[None])
    before = distance[None] < distance[:, None]
    hidden = (before & (apart < half[None])).any(axis=1)
    return np.asarray(visible & ~hidden)


def ranges(
    people: People, room: Room, origin: Float64Array, bearings: Float64Array
) -> Float64Array:
    """(B,) metres from a place to the nearest body or wall in each direction, radians."""
    c, s = np.cos(bearings), np.sin(bearings)
    with np.errstate(divide="ignore"):
        along = np.where(c > 0, (room.length_m - origin[0]) / c, -origin[0] / c)
        across = np.where(s > 0, (room.width_m - origin[1]) / s, -origin[1] / s)
    nearest = np.minimum(np.where(c == 0, np.inf, along), np.where(s == 0, np.inf, across))
    away = people.position - origin
    ahead = away @ np.stack([c, s])
    aside = away @ np.stack([-s, c])
    chord = people.radius_m[:, None] ** 2 - aside**2
    hit = (chord > 0) & (ahead > 0)
    far = np.where(hit, ahead - np.sqrt(np.maximum(chord, 0.0)), np.inf)
    if len(far):
        nearest = np.minimum(nearest, far.min(axis=0))
    return np.maximum(nearest, 0.0)


def _scan(people: People, pose: Float64Array, room: Room) -> FreeScan:
    far = ranges(people, room, pose[:2], _BEARINGS + pose[2])
    known = np.clip(far, _FLOOR_FROM_M, _FLOOR_TO_M)
    return FreeScan(
        bearings=tuple(_BEARINGS.tolist()),
        blocked_m=tuple(each if each < _FLOOR_TO_M else None for each in far.tolist()),
        known_from_m=(_FLOOR_FROM_M,) * len(far),
        known_to_m=tuple(known.tolist()),
    )


class SonarRing:
    """Sonars of one robot: those of an array fire in turn, as on the Pioneers."""

    def __init__(self, ring: tuple[SonarPose, ...]) -> None:
        self._ring = ring
        # At the first packet the sonars have already been running for a full cycle.
        self._fired = 1 - _ARRAY
        self._newest: dict[int, SonarReading] = {}

    def listen(
        self, people: People, room: Room, pose: Float64Array, time: float
    ) -> tuple[SonarReading, ...]:
        """Return the newest readings of each sonar in a packet received at ``time``."""
        until = math.floor(time / _SONAR_EVERY_S + 1e-9)
        for turn in range(max(self._fired, until - _ARRAY + 1), until + 1):
            for index in range(turn % _ARRAY, len(self._ring), _ARRAY):
                self._newest[index] = self._reading(index, people, room, pose, time)
        self._fired = until + 1
        return tuple(self._newest.values())

    def _reading(
        self, index: int, people: People, room: Room, pose: Float64Array, time: float
    ) -> SonarReading:
        one = self._ring[index]
        place = pose[:2] + turned(np.array([one.x, one.y]), pose[2])
        bearings = pose[2] + one.heading + np.linspace(-_SONAR_HALF_RAD, _SONAR_HALF_RAD, 5)
        near = float(ranges(people, room, place, bearings).min())
        heard = near if near < _SONAR_REACH_M else None
        return SonarReading(index, one.x, one.y, one.heading, heard, time)


def turned(vector: Float64Array, angle: float) -> Float64Array:
    """(2,) a vector rotated to the left by an angle in radians."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])
