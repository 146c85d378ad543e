"""What the 3D scene draws of the robot: outline, zones, echoes, goal and path."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from app.contract.robots import (
    DriveProcess,
    RobotsNow,
)
from app.viewer.picture import make_picture
from app.viewer.robot_marks import (
    GOAL_LINES,
    MEETING_LINES,
    MOST_PATH_LINES,
    MOST_REFUSED_LINES,
    MOST_ZONE_LINES,
    robot_marks,
)
from observer.geometry import Pose
from observer.guard.parameters import GuardParameters
from observer.robots.contract import RobotPhase, RobotReport

from .robot_facts import GOAL, GUARD, MOUNT, ROBOT


def _in_base(lines: Any, T_world_camera: Pose) -> Any:
    T_base_world = MOUNT.T_base_camera @ T_world_camera.inverse()
    return T_base_world.apply(np.reshape(lines, (-1, 3))).reshape(-1, 2, 3)


def test_zones_and_outline_are_on_the_floor_around_the_robot() -> None:
    T = Pose.from_rotvec([0.0, 0.4, 0.0], [1.0, 0.0, 2.0])
    marks = robot_marks(ROBOT, MOUNT, T)
    assert marks is not None
    zone = _in_base(marks.stop_zone, T)
    np.testing.assert_allclose(zone[:, 0, :2], GUARD.stop_zone, atol=1e-9)
    np.testing.assert_array_equal(zone[:, 1], np.roll(zone[:, 0], -1, axis=0))
    assert (np.abs(zone[..., 2]) < 0.03).all()
    assert marks.slow_zone.shape == (3, 2, 3)
    outline = _in_base(marks.outline, T)
    np.testing.assert_allclose(np.abs(outline[:4, 0, :2]), [[0.3, 0.2]] * 4, atol=1e-9)
    # The line that points ahead begins at the middle of the axle.
    np.testing.assert_allclose(outline[4, :, :2], [[0.0, 0.0], [0.5, 0.0]], atol=1e-9)
    assert (marks.level, marks.text) == ("slow", "slowed: obstacle 3 is 1.2 m ahead")


def test_only_recent_echoes_are_drawn_at_their_distance() -> None:
    marks = robot_marks(ROBOT, MOUNT, Pose.identity())
    assert marks is not None
    ends = _in_base(marks.sonar, Pose.identity())
    assert ends.shape == (3, 2, 3)
    np.testing.assert_allclose(np.linalg.norm(ends[..., :2] - (0.1, 0.0), axis=-1), 1.4)
    wide = robot_marks(
        ROBOT, MOUNT, Pose.identity(), limits=GuardParameters(sonar_half_angle_deg=30.0)
    )
    assert wide is not None
    along = _in_base(wide.sonar, Pose.identity())[..., :2] - (0.1, 0.0)
    np.testing.assert_allclose(np.arctan2(*along[[0, -1], [0, -1]].T[::-1]), np.radians([-30, 30]))


def test_a_partly_known_robot_is_drawn_as_far_as_known() -> None:
    assert robot_marks(ROBOT, None, Pose.identity()) is None
    assert robot_marks(ROBOT, MOUNT, None) is None
    assert robot_marks(None, MOUNT, Pose.identity()) is None
    unknown = replace(ROBOT, guard=None, report=RobotReport(RobotPhase.CONNECTING))
    marks = robot_marks(unknown, MOUNT, Pose.identity())
    assert marks is not None
    assert len(marks.outline) == len(marks.stop_zone) == len(marks.sonar) == 0
    assert (marks.level, marks.text) == (None, None)
    around = np.linspace(0, 2 * math.pi, 200, endpoint=False)
    corners = np.stack([np.cos(around), np.sin(around)], 1).tolist()
    many = replace(unknown, guard=replace(GUARD, stop_zone=corners))
    circle = robot_marks(many, MOUNT, Pose.identity())
    assert circle is not None
    assert 30 < len(circle.stop_zone) <= MOST_ZONE_LINES


def test_goal_and_path_are_on_the_floor_while_driving_there() -> None:
    T = Pose.from_rotvec([0.0, 0.4, 0.0], [1.0, 0.0, 2.0])
    marks = robot_marks(ROBOT, MOUNT, T, GOAL)
    assert marks is not None
    path = _in_base(marks.path, T)
    np.testing.assert_allclose(path[:, 0, :2], GOAL.path[:2], atol=1e-9)
    np.testing.assert_allclose(path[:, 1, :2], GOAL.path[1:], atol=1e-9)
    assert (np.abs(path[..., 2]) < 0.03).all()
    goal = _in_base(marks.goal, T)
    assert len(goal) == GOAL_LINES
    # Within the ring the goal counts as reached; the flag stands at its centre.
    ring, pole = goal[:-3], goal[-3]
    np.testing.assert_allclose(
        np.linalg.norm(ring[..., :2] - np.array(GOAL.place), axis=-1), 0.25, atol=1e-9
    )
    np.testing.assert_allclose(pole[:, :2], [GOAL.place] * 2, atol=1e-9)
    np.testing.assert_allclose(
        _in_base([marks.T_world_base.translation] * 2, T)[0], np.zeros((2, 3)), atol=1e-9
    )
    for over in (None, replace(GOAL, state="reached"), replace(GOAL, place=None, path=[])):
        nothing = robot_marks(ROBOT, MOUNT, T, over)
        assert nothing is not None
        assert len(nothing.path) == len(nothing.goal) == 0
        if over is None or over.state != "driving":
            assert len(nothing.refused) == len(nothing.meeting) == 0


def test_refused_paths_and_the_predicted_meeting_are_on_the_floor() -> None:
    T = Pose.from_rotvec([0.0, 0.4, 0.0], [1.0, 0.0, 2.0])
    marks = robot_marks(ROBOT, MOUNT, T, GOAL)
    assert marks is not None
    refused, meeting = _in_base(marks.refused, T), _in_base(marks.meeting, T)
    # Short paths are drawn as reported, long ones thinned out up to their end.
    np.testing.assert_allclose(refused[:2, 1, :2], GOAL.refused[0].path[1:], atol=1e-9)
    np.testing.assert_allclose(refused[-1, 1, :2], GOAL.refused[1].path[-1], atol=1e-9)
    assert 2 < len(refused) <= MOST_REFUSED_LINES
    assert len(meeting) == MEETING_LINES
    off = np.linalg.norm(meeting[..., :2] - np.array(GOAL.meets_at), axis=-1)
    np.testing.assert_allclose(off, 0.3, atol=1e-9)
    assert (np.abs(np.concatenate([refused, meeting])[..., 2]) < 0.03).all()
    many = replace(GOAL, refused=[*GOAL.refused] * 9)
    crowded = robot_marks(ROBOT, MOUNT, T, many)
    assert crowded is not None
    assert len(crowded.refused) <= MOST_REFUSED_LINES


def test_a_long_path_keeps_its_end() -> None:
    places = [(0.01 * k, 0.0) for k in range(250)]
    marks = robot_marks(ROBOT, MOUNT, Pose.identity(), replace(GOAL, path=places))
    assert marks is not None
    path = _in_base(marks.path, Pose.identity())
    assert MOST_PATH_LINES / 2 < len(path) <= MOST_PATH_LINES
    np.testing.assert_allclose(path[-1, 1, 0], 2.49, atol=1e-9)
    np.testing.assert_allclose(path[1:, 0], path[:-1, 1])


@pytest.mark.parametrize(
    ("level", "waits_for", "text"),
    [
        ("clear", 3, "Waiting for obstacle 3: it will cross in 1.4 s."),
        ("slow", 3, "Waiting for obstacle 3: it will cross in 1.4 s."),
        ("stop", 3, "stopped: obstacle 3 is 1.2 m ahead"),
        ("slow", None, "slowed: obstacle 3 is 1.2 m ahead"),
        ("clear", None, None),
    ],
)
def test_one_reason_is_shown_in_the_scene(level: Any, waits_for: Any, text: str | None) -> None:
    robot = replace(ROBOT, guard=replace(GUARD, level=level))
    goal = replace(GOAL, waits_for=waits_for)
    marks = robot_marks(robot, MOUNT, Pose.identity(), goal)
    assert marks is not None
    assert marks.text == text
    unguarded = robot_marks(replace(robot, guard=None), MOUNT, Pose.identity(), goal)
    assert unguarded is not None
    assert unguarded.text == (None if waits_for is None else goal.sentence)


def test_no_reason_is_shown_for_a_robot_that_nobody_may_drive() -> None:
    stopped = replace(ROBOT, guard=replace(GUARD, level="stop", reason="no camera frame"))
    states: tuple[Any, ...] = ("armed", "moving", "waiting", "disarmed", "connecting", "refused")
    shown = {
        state
        for state in states
        if (marks := robot_marks(replace(stopped, state=state), MOUNT, Pose.identity()))
        and marks.text is not None
    }
    assert shown == {"armed", "moving"}


def test_the_robot_comes_from_the_drive_process(observed: Any) -> None:
    event, state = observed.observe(), observed.state()
    robots: Any = {"observer": ROBOT, "obstacle": None}
    told = RobotsNow(
        *(None, None, None, None, GOAL, robots),
        process=DriveProcess(True, 1, 0, None),
        world=None,
        ports={},
        trouble={},
        incidents=[],
        check=None,
    )
    drawn = make_picture(event, state, 1, event.received, told).robot
    assert drawn is not None
    assert len(drawn.goal) == GOAL_LINES
    for nothing in (None, replace(told, robots={"observer": None, "obstacle": None})):
        assert make_picture(event, state, 1, event.received, nothing).robot is None
