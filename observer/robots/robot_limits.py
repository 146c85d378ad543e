"""The limits a robot is driven within. Pure."""

from __future__ import annotations

import math

from observer.robots.arcos import Command, command
from observer.robots.config_reply import ConfigReply
from observer.robots.contract import RobotLimits
from observer.robots.models import RobotSpec


def limits_in_force(
    spec: RobotSpec, config: ConfigReply, wanted: RobotLimits | None = None
) -> RobotLimits:
    """The least of the model's own, what the robot says and what is asked for.

    A zero in the robot's reply says nothing. Its accelerations as set are no limits: they are
    what ``limit_commands`` changes.
    """

    def least(own: float, *others: float | None) -> float:
        return min([own, *(each for each in others if each)])

    def told(value: int | None, factor: float) -> float | None:
        return None if value is None else value * factor

    degree = math.pi / 180
    return RobotLimits(
        speed_mps=least(
            spec.speed_max_mps,
            told(config.speed_top, 1e-3),
            told(config.speed_max, 1e-3),
            wanted.speed_mps if wanted else None,
        ),
        turn_rate_radps=least(
            spec.turn_rate_max_radps,
            told(config.turn_rate_top, degree),
            told(config.turn_rate_max, degree),
            wanted.turn_rate_radps if wanted else None,
        ),
        acceleration_mps2=least(
            spec.acceleration_max_mps2,
            told(config.acceleration_top, 1e-3),
            wanted.acceleration_mps2 if wanted else None,
        ),
        turn_acceleration_radps2=least(
            spec.turn_acceleration_max_radps2,
            told(config.turn_acceleration_top, degree),
            wanted.turn_acceleration_radps2 if wanted else None,
        ),
    )


def limit_commands(limits: RobotLimits) -> tuple[bytes, ...]:
    """What tells the robot: SETV, SETRV, SETA and SETRA, the latter two for braking as well."""
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
    """A velocity as it is sent, whole mm/s and deg/s; zero where either is not finite."""
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
    """At least one: zero would mean no limit, or none at all."""
    return max(1, min(32767, int(value + 1e-6)))
