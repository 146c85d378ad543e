"""From the angles of two wheels to the way of their robot."""

from __future__ import annotations

from observer.geometry import along_arc
from observer.types import Odometry


class WheelOdometry:
    """Sums up how the wheels turned, as an arc between two readings."""

    def __init__(self, radius_m: float, track_m: float) -> None:
        self._radius, self._track = radius_m, track_m
        self._before: tuple[float, float] | None = None
        self._x = self._y = self._yaw = 0.0

    def add(self, left_rad: float, right_rad: float) -> Odometry:
        """Of the wheels' angles as they are now; the first ones are the beginning."""
        before, self._before = self._before, (left_rad, right_rad)
        if before is None:
            return self.odometry
        left, right = left_rad - before[0], right_rad - before[1]
        way = (left + right) / 2 * self._radius
        turn = (right - left) * self._radius / self._track
        self._x, self._y = along_arc(self._x, self._y, self._yaw, way, turn)
        self._yaw += turn
        return self.odometry

    def rebase(self) -> None:
        """The joints are put to other angles before the next ones; that is no way."""
        self._before = None

    @property
    def odometry(self) -> Odometry:
        """Since the first angles."""
        return Odometry(self._x, self._y, self._yaw)
