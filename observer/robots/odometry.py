"""Odometry of a robot: its jumps, and wheel odometry accumulated on the host. Pure."""

from __future__ import annotations

import math

from observer.robots.models import RobotSpec
from observer.types import Odometry

# X and Y have 15 bits. A larger apparent step between two packets is a wrap-around.
_WRAP = 0x8000
_WRAPPED_BEYOND = 0x1000
# Packets are buffered: two that arrive together may have been sent more than a period apart.
_LATE_S = 0.3
# Allows for rounding and for the resolution of encoders.
_SLACK_M, _SLACK_RAD = 0.05, 0.1


def is_jump(
    driven_m: float,
    turned_rad: float,
    seconds: float,
    *,
    speed_mps: float,
    turn_rate_radps: float,
) -> bool:
    """Return whether a robot's own odometry changed more than it can have moved.

    Its numbers were reset then, or the robot was restarted.

    Args:
        driven_m, turned_rad: change of its place and of its heading. seconds: longest time that it
            may have taken. speed_mps, turn_rate_radps: highest that the robot reaches.
    """
    return (
        driven_m > speed_mps * seconds + _SLACK_M
        or abs(turned_rad) > turn_rate_radps * seconds + _SLACK_RAD
    )


class WheelOdometry:
    """Accumulates the robot's own odometry, whose numbers wrap around.

    Attributes:
        place: relative to the robot's pose at the first packet, x forward and y left.
        spec: the model.
        jumps: how often the robot's own numbers jumped; a jump counts as standing still.
    """

    def __init__(self, spec: RobotSpec) -> None:
        self.place = Odometry(0.0, 0.0, 0.0)
        self.jumps = 0
        self.spec = spec
        # One turn is a whole number of units; the factor in the robot's manual is rounded.
        self._units_per_turn = round(math.tau / spec.angle_rad)
        self._last: tuple[int, int, int, float] | None = None
        # Rotation from the robot's own axes to ours, radians.
        self._axes = 0.0

    def rebaseline(self) -> None:
        """Map the next packet's numbers to the current place."""
        self._last = None

    def add(self, x: int, y: int, heading: int, time: float) -> Odometry:
        """Add one packet's numbers and return the accumulated odometry.

        Args:
            x, y: 0 to 0x7FFF. heading: units of angle, modulo any number of turns. time: of its
                reception, seconds on a monotonic clock.
        """
        last, self._last = self._last, (x, y, heading, time)
        unit = math.tau / self._units_per_turn
        if last is None:
            self._axes = self.place.yaw - heading * unit
            return self.place
        step = [_unwrapped(now - before) for now, before in zip((x, y), last[:2], strict=True)]
        dx, dy = (each * self.spec.distance_mm / 1000 for each in step)
        turned = (heading - last[2] + self._units_per_turn // 2) % self._units_per_turn
        turned -= self._units_per_turn // 2
        if max(map(abs, step)) > _WRAPPED_BEYOND or is_jump(
            math.hypot(dx, dy),
            turned * unit,
            time - last[3] + _LATE_S,
            speed_mps=self.spec.speed_max_mps,
            turn_rate_radps=self.spec.turn_rate_max_radps,
        ):
            self.jumps += 1
            self._axes = self.place.yaw - heading * unit
            return self.place
        cos, sin = math.cos(self._axes), math.sin(self._axes)
        self.place = Odometry(
            self.place.x + cos * dx - sin * dy,
            self.place.y + sin * dx + cos * dy,
            self.place.yaw + turned * unit,
        )
        return self.place


def _unwrapped(step: int) -> int:
    if step > _WRAPPED_BEYOND:
        return step - _WRAP
    if step < -_WRAPPED_BEYOND:
        return step + _WRAP
    return step
