"""Dead reckoning of where the robot was a moment ago, from the velocities reported since."""

from __future__ import annotations

import math

import numpy as np

from observer.geometry import Float64Array

# After a longer gap the robot's motion in between is unknown.
_LONGEST_GAP_S = 0.25
_CAPACITY = 1024


class DeadReckoning:
    """Poses of the robot's base over the last seconds, in an arbitrary fixed frame.

    It holds at least the last 512 calls: 10 s of a loop of 20 ms.
    """

    def __init__(self) -> None:
        # Columns: time, x, y, yaw.
        self._rows = np.zeros((_CAPACITY, 4))
        self._count = 0

    @property
    def now(self) -> float | None:
        """Time of the last call of ``advance``; None before the first."""
        return float(self._rows[self._count - 1, 0]) if self._count else None

    def advance(self, now: float, speed_mps: float, turn_rate_radps: float) -> bool:
        """Take in the velocity at which the robot drove since the last call.

        Returns:
            False if the earlier poses were dropped: the calls are too far apart, or time ran
            backwards.
        """
        if self._count:
            before, x, y, yaw = self._rows[self._count - 1].tolist()
            dt = now - before
            if 0 <= dt <= _LONGEST_GAP_S:
                middle, distance = yaw + turn_rate_radps * dt / 2, speed_mps * dt
                x, y = x + distance * math.cos(middle), y + distance * math.sin(middle)
                self._append(now, x, y, yaw + turn_rate_radps * dt)
                return True
        self._count = 0
        self._append(now, 0.0, 0.0, 0.0)
        return False

    def _append(self, *row: float) -> None:
        if self._count == _CAPACITY:
            half = _CAPACITY // 2
            self._rows[:half] = self._rows[half:]
            self._count = half
        self._rows[self._count] = row
        self._count += 1

    def poses(self, times: Float64Array) -> Float64Array:
        """Poses (N, 3) at instants (N,); earlier ones are taken as the first remembered pose."""
        rows = self._rows[: self._count]
        return np.stack([np.interp(times, rows[:, 0], rows[:, k]) for k in (1, 2, 3)], axis=-1)

    def then_from_now(self, times: Float64Array) -> Float64Array:
        """Poses (N, 3) of the base as it stands now, in the base frame of each instant (N,).

        Before the first remembered instant the robot is assumed to have stood still.
        """
        x0, y0, yaw0 = self.poses(times).T
        x, y, yaw = self._rows[self._count - 1, 1:]
        c, s = np.cos(yaw0), np.sin(yaw0)
        dx, dy = x - x0, y - y0
        return np.stack([c * dx + s * dy, c * dy - s * dx, yaw - yaw0], axis=-1)


def moved(points: Float64Array, pose: Float64Array) -> Float64Array:
    """Points (N, 2) in the frame in which their own frame has the pose (3,) x, y, yaw."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x, y = points[:, 0], points[:, 1]
    return np.stack([pose[0] + c * x - s * y, pose[1] + s * x + c * y], axis=-1)


def inverse(pose: Float64Array) -> tuple[float, float, float]:
    """The inverse pose."""
    x, y, yaw = (float(value) for value in pose)
    c, s = math.cos(yaw), math.sin(yaw)
    return -c * x - s * y, s * x - c * y, -yaw
