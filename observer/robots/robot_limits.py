"""Limits within which a robot is driven. Pure."""

from __future__ import annotations

import math

from observer.robots.arcos import Command, command
from observer.robots.config_reply import ConfigReply
from observer.robots.contract import RobotLimits
from observer.robots.models import RobotSpec


def limits_in_force(spec: RobotSpec, config: ConfigReply) -> RobotLimits:
    """Return the lower of the model's limits and the robot's own.

    A zero in the robot's reply means unknown. Its current acceleration settings are no limits:
    ``limit_commands`` overwrites them.
    """

    def least(most: float, unit: float, *reported: int | None) -> float:
        return min([most, *(each * unit for each in reported if each)])

    degree = math.pi / 180
    turn_rate, turn_acceleration = spec.turn_rate_max_radps, spec.turn_acceleration_max_radps2
    return RobotLimits(
        least(spec.speed_max_mps, 1e-3, config.speed_top, config.speed_max),
        least(turn_rate, degree, config.turn_rate_top, config.turn_rate_max),
        least(spec.acceleration_max_mps2, 1e-3, config.acceleration_top),
        least(turn_acceleration, degree, config.turn_acceleration_top),
    )


def limit_commands(limits: RobotLimits) -> tuple[bytes, ...]:
    """Return the commands that set the limits; SETA and SETRA for braking, too."""
    speed, acceleration = _whole(limits.speed_mps * 1000), _whole(limits.acceleration_mps2 * 1000)
    turn_rate = _whole(math.degrees(limits.turn_rate_radps))
    turn_acceleration = _whole(math.degrees(limits.turn_acceleration_radps2))
    return (
        command(Command.SETV, speed),
        command(Command.SETRV, turn_rate),
        command(Command.SETA, acceleration),
        command(Command.SETA, -acceleration),
        command(Command.SETRA, turn_acceleration),
        command(Command.SETRA, -turn_acceleration),
    )


def setpoint_within(
    limits: RobotLimits, speed_mps: float, turn_rate_radps: float
) -> tuple[int, int]:
    """Return a velocity as it is sent, in whole mm/s and deg/s; zero if either is not finite."""
    if not (math.isfinite(speed_mps) and math.isfinite(turn_rate_radps)):
        return 0, 0
    return (
        _bounded(speed_mps * 1000, limits.speed_mps * 1000),
        _bounded(math.degrees(turn_rate_radps), math.degrees(limits.turn_rate_radps)),
    )


def _bounded(value: float, limit: float) -> int:
    most = min(int(limit + 1e-6), 32767)
    return round(max(-most, min(most, value)))


def _whole(value: float) -> int:
    """Round down, but to at least 1: zero would mean no limit, or no motion at all."""
    return max(1, min(32767, int(value + 1e-6)))
