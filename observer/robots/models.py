"""Constants of each robot model: conversion factors, limits, outline and sonar.

The factors are those of MobileRobots' parameter files; where sources disagree, a comment at the
value explains the choice.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from observer.errors import InputError
from observer.rig.rig import RobotModel


@dataclass(frozen=True)
class SonarPose:
    """Pose of one sonar: metres and radians in the robot's base frame, z left out."""

    x: float
    y: float
    heading: float


@dataclass(frozen=True)
class RobotSpec:
    """A robot's constants.

    Attributes:
        model: its name, as in ``rig.yaml``. title: for people; variant: tells models with the same
            title apart.
        distance_mm: millimetres per unit of X and Y. speed_mmps: mm/s per unit of wheel speed.
        angle_rad: radians per unit of TH. wheel_turn: rad/s per half the difference of the wheel
            speeds in mm/s, to compute the turn rate where none is reported.
        speed_max_mps, turn_rate_max_radps: never exceeded.
        radius_m: of the turning circle. width_m, length_m: its outline; the axle is assumed to be
            in its middle.
        sonars: empty where it has none.
        high_speed_serial: baud rate above 9600 that may be requested, None where none may.
        flag_bits: the bits of the status packet's flags that have a meaning for this model.
        acceleration_max_mps2, turn_acceleration_max_radps2: the highest requested, also for
            braking, unless the robot reports lower ones.
    """

    model: RobotModel
    title: str
    variant: str
    distance_mm: float
    speed_mmps: float
    angle_rad: float
    wheel_turn: float
    speed_max_mps: float
    turn_rate_max_radps: float
    radius_m: float
    width_m: float
    length_m: float
    sonars: tuple[SonarPose, ...]
    high_speed_serial: int | None = 38400
    flag_bits: int = 0xFFFF
    acceleration_max_mps2: float = 2.0
    turn_acceleration_max_radps2: float = math.radians(300)


def robot_spec(model: str) -> RobotSpec:
    """Return the constants of a model.

    Raises:
        InputError: it is unknown; the message lists the known ones.
    """
    if model not in SPECS:
        raise InputError(f"there is no robot model {model!r}; available are {', '.join(SPECS)}")
    return SPECS[model]


def _ring(*poses: tuple[float, float, float]) -> tuple[SonarPose, ...]:
    """Sonar poses from x and y in millimetres and the heading in degrees."""
    return tuple(SonarPose(x / 1000, y / 1000, math.radians(deg)) for x, y, deg in poses)


_P3DX_SONARS = _ring(
    (69, 136, 90), (114, 119, 50), (148, 78, 30), (166, 27, 10),
    (166, -27, -10), (148, -78, -30), (114, -119, -50), (69, -136, -90),
    (-157, -136, -90), (-203, -119, -130), (-237, -78, -150), (-255, -27, -170),
    (-255, 27, 170), (-237, 78, 150), (-203, 119, 130), (-157, 136, 90),
)  # fmt: skip
_AMIGO_SONARS = _ring(
    (70, 100, 90), (125, 75, 41), (144, 30, 15), (144, -30, -15),
    (120, -75, -41), (70, -100, -90), (-146, -58, -145), (-146, 58, 145),
)  # fmt: skip
# SH manuals give TH in degrees; ARIA and p2os use this unit, and the firmware sends it.
_ANGLE_RAD = 0.001534
_SH, _OLDER = "SH controller", "older"


def _p3dx(model: RobotModel, variant: str, distance_mm: float) -> RobotSpec:
    return RobotSpec(
        model, "Pioneer P3-DX", variant, distance_mm, 1.0, _ANGLE_RAD, 0.0056, 2.2,
        math.radians(500), 0.250, 0.425, 0.511, _P3DX_SONARS,
    )  # fmt: skip


def _amigo(model: RobotModel, variant: str, distance_mm: float, speed_mmps: float) -> RobotSpec:
    return RobotSpec(
        model, "AmigoBot", variant, distance_mm, speed_mmps, _ANGLE_RAD, 0.011, 1.0,
        math.radians(300), 0.180, 0.279, 0.330, _AMIGO_SONARS, flag_bits=0b11,
    )  # fmt: skip


SPECS: Mapping[str, RobotSpec] = {
    "p3dx-sh": _p3dx("p3dx-sh", _SH, 1.0),
    "p3dx": _p3dx("p3dx", _OLDER, 0.485),
    # p2os uses 1.3746 for the speed; the vendor's own file says 1.
    "amigo-sh": _amigo("amigo-sh", _SH, 1.0, 1.0),
    "amigo": _amigo("amigo", _OLDER, 0.5083, 0.6154),
}
