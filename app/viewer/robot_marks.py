"""Observing robot in the scene: its outline, the guard's zones, its sonar; pure geometry."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from app.contract.robots import GuardVerdict, RobotNow
from observer.geometry import Float64Array, Pose
from observer.mount import CameraMount
from observer.robots.contract import RobotReport, SonarReading

Level = Literal["clear", "slow", "stop"]
MOST_OUTLINE_LINES = 7
MOST_ZONE_LINES = 48
MOST_SONARS = 16
LINES_OF_A_SONAR = 3
MOST_SONAR_LINES = MOST_SONARS * LINES_OF_A_SONAR

# Just above the floor, so that the floor's own lines do not cut through.
_ZONE_HEIGHT_M = 0.012
_SONAR_HEIGHT_M = 0.16
_BODY_HEIGHT_M = 0.02
_TEXT_HEIGHT_M = 0.75
_SONAR_HALF_CONE_RAD = math.radians(15)
# Beyond this an echo reveals nothing of the robot's surroundings.
_SONAR_REACH_M = 4.0
_SONAR_OLD_S = 1.0
_HEADING_M = 0.2
_ARROW_M = 0.07


@dataclass(frozen=True, eq=False)
class RobotMarks:
    """Lines (N, 2, 3) and a place in the world frame, metres.

    Attributes:
        outline: of the robot, with its heading.
        stop_zone, slow_zone: on the floor.
        sonar: short arcs at echoes within the last second.
        level: of the guard; None where it reports nothing.
        text: the reason why the guard limits the robot, None while it does not.
        place: (3,) of the text.
    """

    outline: Float64Array
    stop_zone: Float64Array
    slow_zone: Float64Array
    sonar: Float64Array
    level: Level | None
    text: str | None
    place: Float64Array


def robot_marks(
    robot: RobotNow | None, mount: CameraMount | None, T_world_camera: Pose | None
) -> RobotMarks | None:
    """Return the marks of the observing robot; None if nothing is known of it or its place.

    Args:
        robot: the observer's.
    """
    if robot is None or mount is None or T_world_camera is None:
        return None
    T_world_base = T_world_camera @ mount.T_base_camera.inverse()
    report, guard = robot.report, robot.guard

    def world(lines: Float64Array) -> Float64Array:
        return np.asarray(T_world_base.apply(lines.reshape(-1, 3)).reshape(-1, 2, 3))

    return RobotMarks(
        outline=world(_outline(report)),
        stop_zone=world(_zone(() if guard is None else guard.stop_zone)),
        slow_zone=world(_zone(() if guard is None else guard.slow_zone)),
        sonar=world(_sonar(report.sonars, report.received)),
        level=None if guard is None else guard.level,
        text=None if guard is None else _text(guard),
        place=np.asarray(T_world_base.apply(np.array([0.0, 0.0, _TEXT_HEIGHT_M]))),
    )


def _text(guard: GuardVerdict) -> str | None:
    if guard.level == "clear":
        return None
    word = "slowed" if guard.level == "slow" else "stopped"
    return word if guard.reason is None else f"{word}: {guard.reason}"


def _outline(report: RobotReport) -> Float64Array:
    width, length = report.width_m, report.length_m
    if width is None or length is None:
        return np.zeros((0, 2, 3))
    ahead, side = length / 2, width / 2
    tip = ahead + _HEADING_M
    body = _closed([(ahead, side), (-ahead, side), (-ahead, -side), (ahead, -side)])
    arrow = [
        ((0.0, 0.0), (tip, 0.0)),
        ((tip, 0.0), (tip - _ARROW_M, _ARROW_M)),
        ((tip, 0.0), (tip - _ARROW_M, -_ARROW_M)),
    ]
    return _raised(np.concatenate([body, np.array(arrow)]), _BODY_HEIGHT_M)


def _zone(corners: Sequence[Sequence[float]]) -> Float64Array:
    if len(corners) < 3:
        return np.zeros((0, 2, 3))
    step = -(-len(corners) // MOST_ZONE_LINES)
    return _raised(_closed(corners[::step]), _ZONE_HEIGHT_M)


def _sonar(sonars: Sequence[SonarReading], received: float | None) -> Float64Array:
    """Return chords along the arc of each echo; the robot's newest report tells each echo's age."""
    newest = max([received or -math.inf, *(each.received for each in sonars)])
    lines = []
    for each in sonars:
        distance = each.range_m
        old = newest - each.received > _SONAR_OLD_S
        if distance is None or distance > _SONAR_REACH_M or old:
            continue
        angle = each.heading + np.linspace(
            -_SONAR_HALF_CONE_RAD, _SONAR_HALF_CONE_RAD, LINES_OF_A_SONAR + 1
        )
        arc = np.stack([np.cos(angle), np.sin(angle)], axis=1) * distance
        arc += (each.x, each.y)
        lines.append(np.stack([arc[:-1], arc[1:]], axis=1))
    if not lines:
        return np.zeros((0, 2, 3))
    return _raised(np.concatenate(lines), _SONAR_HEIGHT_M)


def _closed(corners: Sequence[Sequence[float]]) -> Float64Array:
    """Return (N, 2, 2) lines around N corners."""
    points = np.array(corners, dtype=np.float64)[:, :2]
    return np.stack([points, np.roll(points, -1, axis=0)], axis=1)


def _raised(lines: Float64Array, height_m: float) -> Float64Array:
    """Return (N, 2, 3) lines from flat ones (N, 2, 2)."""
    return np.concatenate([lines, np.full((*lines.shape[:2], 1), height_m)], axis=2)
