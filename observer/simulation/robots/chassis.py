"""Interface between a robot's firmware and the machine below it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True)
class Drive:
    """Command of the firmware to its motors.

    Attributes:
        speed_mps, turn_rate_radps: reached by constant ramps; positive forward and left.
        acceleration_mps2, deceleration_mps2: > 0, of the speed.
        turn_acceleration_radps2, turn_deceleration_radps2: > 0, of the turn rate.
        powered: the motors are on; when off, the machine coasts to a stop by friction.
    """

    speed_mps: float = 0.0
    turn_rate_radps: float = 0.0
    acceleration_mps2: float = 0.3
    deceleration_mps2: float = 0.3
    turn_acceleration_radps2: float = 1.75
    turn_deceleration_radps2: float = 1.75
    powered: bool = False


@dataclass(frozen=True)
class Wheels:
    """Measurements of the firmware's own machine.

    Attributes:
        x, y, yaw: encoder odometry since the machine was built, metres and rad, not wrapped.
        left_m, right_m: distance travelled by each wheel, metres.
        speed_mps, turn_rate_radps: from the encoders.
        stalled: whether the left and the right wheel push without turning.
        front_bumpers, rear_bumpers: bit k is bumper k; 0 where none are fitted.
    """

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    left_m: float = 0.0
    right_m: float = 0.0
    speed_mps: float = 0.0
    turn_rate_radps: float = 0.0
    stalled: tuple[bool, bool] = (False, False)
    front_bumpers: int = 0
    rear_bumpers: int = 0


class Chassis(Protocol):
    """The machine below a firmware; every method may be called from the firmware's thread."""

    def drive(self, drive: Drive) -> None:
        """Command the motors from now on."""
        ...

    def wheels(self) -> Wheels:
        """Return the current measurements."""
        ...

    def sonar(self, index: int) -> float | None:
        """Return the distance in metres to the nearest surface in a sonar's cone; None if none."""
        ...
