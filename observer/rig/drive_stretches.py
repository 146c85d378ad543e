"""A drive cut into stretches, with the motion of camera and wheels in each."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from observer.geometry import Float64Array, Pose
from observer.rig.estimates import Refused
from observer.types import Odometry

# A stretch ends once one of these is reached: long enough for its motion to stand out from the
# noise, short enough that there are many of them.
_STRETCH_TURN, _STRETCH_DISTANCE_M = math.radians(10), 0.15
# Limits of one step; beyond, the wheel odometry was reset, the robot was carried, or samples
# are missing.
_MOST_STEP_M, _MOST_STEP_RAD, _MOST_STEP_S = 1.0, math.radians(60), 1.0


@dataclass(frozen=True, eq=False)
class DriveSample:
    """Poses of camera and wheels at one instant.

    Attributes:
        time: seconds on the source's clock. segment: of the world that the pose is given in.
        T_world_camera: None where it is unknown. odometry: None where it is unknown.
    """

    time: float
    segment: int
    T_world_camera: Pose | None
    odometry: Odometry | None


@dataclass(frozen=True, eq=False)
class Stretch:
    """Motion of camera and wheels from one instant to a later one.

    Attributes:
        turn: (3,) rotation vector, radians, and translation: (3,) metres, of the camera: its later
            pose in its earlier axes.
        steps: (K, 2) metres ahead and to the left by the wheels, each in the axes that the robot
            had at the middle of the step. wheel_turns: (K,) radians to the left.
    """

    turn: Float64Array
    translation: Float64Array
    steps: Float64Array
    wheel_turns: Float64Array

    @property
    def seen_m(self) -> float:
        return float(np.linalg.norm(self.translation))

    @property
    def seen_rad(self) -> float:
        return float(np.linalg.norm(self.turn))

    @property
    def driven_m(self) -> float:
        """Length of the robot's path, curved or straight, by its wheels."""
        return float(np.hypot(*self.steps.T).sum())

    @property
    def wheel_turn(self) -> float:
        return float(self.wheel_turns.sum())


class WheelPaths:
    """The wheels' paths of the stretches, which can be bent to the turns that the camera saw."""

    def __init__(self, stretches: Sequence[Stretch]) -> None:
        count = max((len(one.steps) for one in stretches), default=0)
        # Steps as complex numbers, ahead + i left; padded with 0 beyond a stretch's last step.
        self._steps = np.zeros((len(stretches), count), np.complex128)
        self._heading = np.zeros((len(stretches), count))
        # Share of a stretch's steps that lie before the middle of each.
        self._share = np.zeros((len(stretches), count))
        self._turn = np.array([one.wheel_turn for one in stretches])
        for row, one in enumerate(stretches):
            k = len(one.steps)
            self._steps[row, :k] = one.steps[:, 0] + 1j * one.steps[:, 1]
            self._heading[row, :k] = np.cumsum(one.wheel_turns) - one.wheel_turns / 2
            self._share[row, :k] = (np.arange(k) + 0.5) / k

    def driven(self, turn: Float64Array) -> Float64Array:
        """(N, 3) metres from start to end by the wheels, in the base's axes at the start.

        Args:
            turn: (N,) radians over each whole stretch, as the camera saw it: wheels measure
                distances well and turns badly. The difference to the wheels' turn is spread evenly
                over the steps.
        """
        heading = self._heading + (turn - self._turn)[:, None] * self._share
        way = (self._steps * np.exp(1j * heading)).sum(axis=1)
        return np.stack([way.real, way.imag, np.zeros(len(way))], axis=1)


def drive_stretches(samples: Sequence[DriveSample]) -> list[Stretch] | Refused:
    """Return the drive as stretches that do not overlap; times of standing still are left out.

    Samples without a pose or odometry are skipped. No stretch spans a change of segment, time going
    back, more than a second between samples, or a jump of the wheels.
    """
    if not any(sample.odometry is not None for sample in samples):
        return Refused(
            "the robot reports no wheel odometry, so the camera's position on it cannot be "
            "estimated from a drive; enter it by hand, or use a source with odometry"
        )
    if not any(sample.T_world_camera is not None for sample in samples):
        return Refused(
            "the ego-motion is unknown in every frame; check that the camera sees a textured scene "
            "and is calibrated"
        )
    return [stretch for run in _unbroken(samples) for stretch in _cut(run)]


@dataclass(frozen=True, eq=False)
class _Known:
    """A sample with both poses known."""

    time: float
    segment: int
    T_world_camera: Pose
    odometry: Odometry


def _unbroken(samples: Iterable[DriveSample]) -> Iterator[list[_Known]]:
    run: list[_Known] = []
    for one in samples:
        if one.T_world_camera is None or one.odometry is None:
            continue
        known = _Known(one.time, one.segment, one.T_world_camera, one.odometry)
        if run and not _follows(run[-1], known):
            yield run
            run = []
        run.append(known)
    yield run


def _follows(before: _Known, now: _Known) -> bool:
    a, b = before.odometry, now.odometry
    return (
        before.segment == now.segment
        and 0 < now.time - before.time <= _MOST_STEP_S
        and math.hypot(b.x - a.x, b.y - a.y) <= _MOST_STEP_M
        and abs(_turned(a, b)) <= _MOST_STEP_RAD
    )


def _cut(run: list[_Known]) -> Iterator[Stretch]:
    begin: _Known | None = None
    steps: list[tuple[float, float]] = []
    turns: list[float] = []
    for a, b in pairwise(run):
        step, turn = _wheel_step(a.odometry, b.odometry)
        if begin is None:
            begin = a
        steps.append(step)
        turns.append(turn)
        driven_m = sum(math.hypot(*one) for one in steps)
        if not (any(turns) or driven_m):
            # Still standing: the stretch begins where the robot sets off.
            begin, steps, turns = None, [], []
            continue
        if abs(sum(turns)) >= _STRETCH_TURN or driven_m >= _STRETCH_DISTANCE_M:
            moved = begin.T_world_camera.inverse() @ b.T_world_camera
            yield Stretch(moved.rotvec, moved.translation, np.array(steps), np.array(turns))
            begin, steps, turns = None, [], []


def _wheel_step(before: Odometry, now: Odometry) -> tuple[tuple[float, float], float]:
    turn = _turned(before, now)
    heading = before.yaw + turn / 2
    c, s = math.cos(heading), math.sin(heading)
    dx, dy = now.x - before.x, now.y - before.y
    return (c * dx + s * dy, c * dy - s * dx), turn


def _turned(before: Odometry, now: Odometry) -> float:
    return math.remainder(now.yaw - before.yaw, 2 * math.pi)
