"""Motion capture as ground truth, on the source's clock and in the observer's world."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable, Mapping

import numpy as np

from observer.geometry import Float64Array, Pose
from observer.truth.alignment.curves import GAP_INTERVALS, between, window_for
from observer.truth.alignment.result import Alignment
from observer.truth.alignment.rooms import body_poses, centre_positions
from observer.truth.contract import TrueBody
from observer.truth.motion_capture import Capture, Trajectory
from observer.truth.speeds import smoothed_velocity

# Metres: size of all bodies, which nobody measures; length, width, height of a Pioneer P3-DX.
DEFAULT_SIZE = np.array([0.455, 0.381, 0.237])
# Seconds: short enough to keep the ramp of a start, long enough to suppress millimetre noise
# (0.3-0.9 mm/s remain with 11 samples at 100 Hz).
VELOCITY_SMOOTHING_S = 0.11
_NEIGHBOURS = 8

# Position, velocity and heading of a body, each (3,) in the room.
State = tuple[Float64Array, Float64Array, Float64Array]


def numbered(names: Iterable[str], roles: Mapping[str, str]) -> list[tuple[int, str]]:
    """Number the bodies that have a role: 0 for the observer, then obstacles from 1."""
    order = sorted((n for n in names if n in roles), key=lambda n: roles[n] != "observer")
    return list(enumerate(order, 0 if order and roles[order[0]] == "observer" else 1))


def placed_body(number: int, name: str, role: str, state: State, T_world_room: Pose) -> TrueBody:
    """Transform a body from the room to the world; its size is assumed to be a P3-DX's."""
    position, velocity, heading = state
    forward = T_world_room.rotate(heading)
    return TrueBody(
        id=number,
        name=name,
        role=role,
        position=T_world_room.apply(position),
        velocity=T_world_room.rotate(velocity),
        size=DEFAULT_SIZE,
        yaw=math.atan2(float(forward[0]), float(forward[2])),
        visible=None,
        commanded_speed=None,
    )


class AlignedTruth:
    """Fulfils ``observer.truth.contract.Truth``; the world is that of the segment at each time.

    Args:
        capture: as it was aligned. alignment: the capture's.
    """

    def __init__(self, capture: Capture, alignment: Alignment) -> None:
        self._alignment = alignment
        self._bodies: list[tuple[int, Trajectory, Float64Array]] = []
        for number, name in numbered(capture.bodies, alignment.roles):
            body = capture.bodies[name]
            self._bodies.append((number, body, _centre_velocities(body, alignment)))

    def bodies(self, time: float) -> tuple[TrueBody, ...]:
        """Return every body known at ``time`` (source clock), in the world of its segment.

        Bodies in a gap are left out; so are all bodies if the room's pose is unknown.
        """
        T_world_room = self._T_world_room(time)
        if T_world_room is None:
            return ()
        found = []
        for number, body, rates in self._bodies:
            state = self._state(body, rates, time)
            if state is None:
                continue
            role = self._alignment.roles[body.name]
            found.append(placed_body(number, body.name, role, state, T_world_room))
        return tuple(found)

    def camera_pose(self, time: float) -> Pose | None:
        """Return ``T_world_camera`` from motion capture; None where the observer was not seen."""
        observer, T_body_camera = self._alignment.observer, self._alignment.T_body_camera
        T_world_room = self._T_world_room(time)
        if observer is None or T_body_camera is None or T_world_room is None:
            return None
        body = next(b for _, b, *_ in self._bodies if b.name == observer)
        at = self._alignment.time.to_truth(np.array([time]))
        pose = body_poses(body.part(_slice(body.times, at)), at)[0]
        if not np.isfinite(pose).all():
            return None
        return T_world_room @ Pose.from_matrix(pose) @ T_body_camera

    def speed(self, name: str, time: float) -> float | None:
        """Return a body's speed at ``time``, m/s; available even if frames were not aligned."""
        for _, body, rates in self._bodies:
            if body.name == name:
                at = self._alignment.time.to_truth(np.array([time]))
                some = _slice(body.times, at)
                speed = float(np.linalg.norm(between(body.times[some], rates[some], at)))
                return speed if math.isfinite(speed) else None
        return None

    def _T_world_room(self, time: float) -> Pose | None:
        segments = self._alignment.segments
        if not segments:
            return None
        index = max(bisect_right(segments, time, key=lambda segment: segment[1]) - 1, 0)
        return self._alignment.T_world_room.get(segments[index][0])

    def _state(self, body: Trajectory, rates: Float64Array, time: float) -> State | None:
        at = self._alignment.time.to_truth(np.array([time]))
        some = _slice(body.times, at)
        velocity = between(body.times[some], rates[some], at)[0]
        body = body.part(some)
        place = centre_positions(body, at, self._alignment.centre(body.name))[0]
        if not (np.isfinite(place).all() and np.isfinite(velocity).all()):
            return None
        heading = velocity
        if body.rotations is not None:
            heading = body_poses(body, at)[0, :3, 0]
        return place, velocity, heading


def _slice(times: Float64Array, at: Float64Array) -> slice:
    """Return the slice of samples around one instant, so that cost does not grow with length."""
    middle = int(np.searchsorted(times, at[0]))
    return slice(max(middle - _NEIGHBOURS, 0), middle + _NEIGHBOURS)


def _centre_velocities(body: Trajectory, alignment: Alignment) -> Float64Array:
    """Return velocities (N, 3) m/s, room, of the centre, which swings as the body turns."""
    rates = smoothed_velocity(
        body.times,
        body.fixed_points(alignment.centre(body.name)),
        window=window_for(body.times, VELOCITY_SMOOTHING_S),
        longest_step=GAP_INTERVALS,
    )
    # Truth's clock runs too fast or too slow by the drift.
    return rates / (1 + 1e-6 * alignment.time.drift_ppm)
