"""Observing robot in the scene: its outline, the guard's zones, its sonar, its goal and the paths
there; pure geometry."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from app.contract.robots import DRIVEN_STATES, GoalNow, GuardVerdict, RobotNow
from app.viewer.shapes import thinned
from observer.geometry import Float64Array, Pose
from observer.guard.guard import Level
from observer.guard.parameters import GuardParameters
from observer.mount import CameraMount
from observer.navigation.errand import REACHED_M
from observer.navigation.plan import MOST_REFUSED, RefusedPath
from observer.robots.contract import RobotReport

MOST_OUTLINE_LINES = 7
MOST_ZONE_LINES = 48
MOST_SONARS = 16
LINES_OF_A_SONAR = 3
MOST_SONAR_LINES = MOST_SONARS * LINES_OF_A_SONAR
MOST_PATH_LINES = 60
_LINES_OF_A_REFUSED = 4
MOST_REFUSED_LINES = MOST_REFUSED * _LINES_OF_A_REFUSED
_RING_LINES = 32
_FLAG_LINES = 3
GOAL_LINES = _RING_LINES + _FLAG_LINES
_CROSS_LINES = 2
MEETING_LINES = _RING_LINES + _CROSS_LINES
USUAL_GUARD = GuardParameters()

# Just above the floor, so that the floor's own lines do not cut through.
_ZONE_HEIGHT_M = 0.012
_PATH_HEIGHT_M = 0.016
_REFUSED_HEIGHT_M = 0.014
_FLAG_HEIGHT_M = 0.5
_FLAG_M = 0.18
# About the radius of a person.
_MEETING_RADIUS_M = 0.3
_SONAR_HEIGHT_M = 0.16
_BODY_HEIGHT_M = 0.02
_TEXT_HEIGHT_M = 0.75
# An echo from farther away reveals nothing of the robot's surroundings.
_SONAR_REACH_M = 4.0
_SONAR_OLD_S = 1.0
_HEADING_M = 0.2
_ARROW_M = 0.07


@dataclass(frozen=True, eq=False)
class RobotMarks:
    """Lines (N, 2, 3) and the position of a text in the world frame, metres.

    Attributes:
        outline: of the robot, with its heading.
        stop_zone, slow_zone: on the floor.
        sonar: short arcs at echoes within the last second.
        path: planned on the way to the goal, on the floor.
        refused: rejected paths, on the floor.
        meeting: a ring with a cross on the floor where the robot is predicted to meet the obstacle
            that decides.
        goal: a ring on the floor, with the radius within which the goal counts as reached, and a
            flag; for a goal to which the robot drives.
        level: of the guard; None if it reports nothing.
        text: the reason why the guard limits the robot or why it waits on its way to the goal;
            None if neither is so, or nobody may drive it.
        place: (3,) of the text.
        T_world_base: the robot itself.
    """

    outline: Float64Array
    stop_zone: Float64Array
    slow_zone: Float64Array
    sonar: Float64Array
    path: Float64Array
    refused: Float64Array
    meeting: Float64Array
    goal: Float64Array
    level: Level | None
    text: str | None
    place: Float64Array
    T_world_base: Pose


def robot_marks(
    robot: RobotNow | None,
    mount: CameraMount | None,
    T_world_camera: Pose | None,
    goal: GoalNow | None = None,
    limits: GuardParameters = USUAL_GUARD,
) -> RobotMarks | None:
    """Return the marks of the observing robot; None if nothing is known of it or its position.

    Args:
        robot: the observer's. goal: the one to which it drives, or drove last.
        limits: the guard's current parameters.
    """
    if robot is None or mount is None or T_world_camera is None:
        return None
    T_world_base = T_world_camera @ mount.T_base_camera.inverse()
    report, guard = robot.report, robot.guard
    aim = goal if goal is not None and goal.state == "driving" else None

    def world(lines: Float64Array) -> Float64Array:
        return np.asarray(T_world_base.apply(lines.reshape(-1, 3)).reshape(-1, 2, 3))

    return RobotMarks(
        outline=world(_outline(report)),
        stop_zone=world(_zone(() if guard is None else guard.stop_zone)),
        slow_zone=world(_zone(() if guard is None else guard.slow_zone)),
        sonar=world(_sonar(report, math.radians(limits.sonar_half_angle_deg))),
        path=world(_path(() if aim is None else aim.path)),
        refused=world(_refused(() if aim is None else aim.refused)),
        meeting=world(_meeting(None if aim is None else aim.meets_at)),
        goal=world(_goal(None if aim is None else aim.place)),
        level=None if guard is None else guard.level,
        # While it is not driven, the guard holds nothing back, and its reason would be noise.
        text=_text(guard, aim) if robot.state in DRIVEN_STATES else None,
        place=np.asarray(T_world_base.apply(np.array([0.0, 0.0, _TEXT_HEIGHT_M]))),
        T_world_base=T_world_base,
    )


def _text(guard: GuardVerdict | None, aim: GoalNow | None) -> str | None:
    """Return the one reason to show: that of a stop comes before that of slowing down."""
    level = "clear" if guard is None else guard.level
    if level != "stop" and aim is not None and aim.waits_for is not None:
        return aim.sentence
    if guard is None or level == "clear":
        return None
    word = "slowed" if level == "slow" else "stopped"
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


def _path(places: Sequence[Sequence[float]]) -> Float64Array:
    return _raised(_through(places, MOST_PATH_LINES), _PATH_HEIGHT_M)


def _refused(paths: Sequence[RefusedPath]) -> Float64Array:
    lines = [_through(one.path, _LINES_OF_A_REFUSED) for one in paths[:MOST_REFUSED]]
    return _raised(np.concatenate([np.zeros((0, 2, 2)), *lines]), _REFUSED_HEIGHT_M)


def _through(places: Sequence[Sequence[float]], most: int) -> Float64Array:
    """Return (N, 2, 2) lines through places, at most ``most``; the last place is always kept."""
    if len(places) < 2:
        return np.zeros((0, 2, 2))
    points = np.array(places, dtype=np.float64)[:, :2]
    kept = points[:-1][thinned(len(points) - 1, most)]
    flat = np.concatenate([kept, points[-1:]])
    return np.stack([flat[:-1], flat[1:]], axis=1)


def _meeting(place: Sequence[float] | None) -> Float64Array:
    if place is None:
        return np.zeros((0, 2, 3))
    half = _MEETING_RADIUS_M * math.sqrt(0.5)
    cross = np.array([((-half, -half), (half, half)), ((-half, half), (half, -half))])
    lines = np.concatenate([_ring(_MEETING_RADIUS_M), cross]) + np.asarray(place, np.float64)
    return _raised(lines, _PATH_HEIGHT_M)


def _ring(radius_m: float) -> Float64Array:
    """Return (N, 2, 2) lines around the origin."""
    around = np.linspace(0, 2 * math.pi, _RING_LINES, endpoint=False)
    return _closed(radius_m * np.stack([np.cos(around), np.sin(around)], axis=1))


def _goal(place: Sequence[float] | None) -> Float64Array:
    if place is None:
        return np.zeros((0, 2, 3))
    top, low = _FLAG_HEIGHT_M, _FLAG_HEIGHT_M - _FLAG_M
    tip = (0.0, -_FLAG_M, (top + low) / 2)
    flag = np.array(
        [
            ((0.0, 0.0, _PATH_HEIGHT_M), (0.0, 0.0, top)),
            ((0.0, 0.0, top), tip),
            (tip, (0.0, 0.0, low)),
        ]
    )
    lines = np.concatenate([_raised(_ring(REACHED_M), _PATH_HEIGHT_M), flag])
    return np.asarray(lines + np.array([place[0], place[1], 0.0]))


def _sonar(report: RobotReport, half_cone_rad: float) -> Float64Array:
    """Return chords along the arc of each echo; echoes are aged by the robot's newest report."""
    newest = max([report.received or -math.inf, *(each.received for each in report.sonars)])
    across = np.linspace(-half_cone_rad, half_cone_rad, LINES_OF_A_SONAR + 1)
    lines = []
    for each in report.sonars:
        distance = each.range_m
        old = newest - each.received > _SONAR_OLD_S
        if distance is None or distance > _SONAR_REACH_M or old:
            continue
        angle = each.heading + across
        arc = np.stack([np.cos(angle), np.sin(angle)], axis=1) * distance
        arc += (each.x, each.y)
        lines.append(np.stack([arc[:-1], arc[1:]], axis=1))
    if not lines:
        return np.zeros((0, 2, 3))
    return _raised(np.concatenate(lines), _SONAR_HEIGHT_M)


def _closed(corners: ArrayLike) -> Float64Array:
    """Return (N, 2, 2) lines around N corners."""
    points = np.array(corners, dtype=np.float64)[:, :2]
    return np.stack([points, np.roll(points, -1, axis=0)], axis=1)


def _raised(lines: Float64Array, height_m: float) -> Float64Array:
    """Return (N, 2, 3) lines from flat ones (N, 2, 2)."""
    return np.concatenate([lines, np.full((*lines.shape[:2], 1), height_m)], axis=2)
