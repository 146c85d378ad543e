"""What the 3D scene shows: geometry by construction, then viser's own nodes."""

from __future__ import annotations

import asyncio
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.contract.commands import OpenSource
from app.contract.drive import DriveState
from app.contract.events import EngineState, LocalMapEvent
from app.contract.robots import (
    DriveFacts,
    DriveProcess,
    GoalNow,
    GuardVerdict,
    RobotNow,
    RobotsNow,
    Velocity,
)
from app.runtime.latest import Latest
from app.server import Server
from app.storage import Storage
from app.viewer import ViserViewer
from app.viewer.picture import make_picture, read_cloud
from app.viewer.robot_marks import (
    GOAL_LINES,
    MEETING_LINES,
    MOST_PATH_LINES,
    MOST_REFUSED_LINES,
    MOST_ZONE_LINES,
    robot_marks,
)
from app.viewer.shapes import (
    Follower,
    box_edges,
    floor_lines,
    padded,
    rig_edges,
    thinned,
    trail_segments,
    upright_rotation,
)
from app.viewer.trails import Trails
from observer.geometry import Pose
from observer.guard.parameters import GuardParameters
from observer.mount import CameraMount, level_pose
from observer.navigation.plan import RefusedPath
from observer.occupancy import OccupancyMap
from observer.robots.contract import RobotPhase, RobotReport, SonarReading

ANGLES = st.floats(-1.4, 1.4)


# --- geometry -----------------------------------------------------------------------------


def test_a_level_camera_looks_along_x_at_its_height() -> None:
    T = level_pose(CameraMount(0.4, 0.0))
    np.testing.assert_allclose(T.apply([0, 0, 2]), [2, 0, 0.4], atol=1e-12)
    np.testing.assert_allclose(T.apply([1, 0, 0]), [0, -1, 0.4], atol=1e-12)
    np.testing.assert_allclose(T.apply([0, 0.4, 0]), [0, 0, 0], atol=1e-12)


@settings(deadline=None, max_examples=50)
@given(st.floats(0.1, 3), st.floats(0.01, 1.2))
def test_a_tilted_camera_sees_the_floor_at_zero(height: float, tilt: float) -> None:
    # The optical axis meets the floor at this distance.
    on_axis = height / math.sin(tilt)
    at = level_pose(CameraMount(height, tilt)).apply([0, 0, on_axis])
    np.testing.assert_allclose(at, [height / math.tan(tilt), 0, 0], atol=1e-9)


def test_the_rig_is_on_the_floor_below_a_tilted_camera() -> None:
    mount = CameraMount(0.4, 0.3, 0.1, 0.06, roll_rad=0.05)
    display = level_pose(mount)
    # Straight ahead by a metre, in display axes.
    shift = Pose(np.eye(3), display.rotation.T @ np.array([1.0, 0, 0]))
    lines = display.apply(rig_edges(mount, shift).reshape(-1, 3)).reshape(-1, 2, 3)
    np.testing.assert_allclose(lines[0], [[1.0, 0.0, 0.4], [1.0, 0.0, 0.0]], atol=1e-9)
    # The middle of the axle is behind the camera and to its right.
    np.testing.assert_allclose(lines[1][1], [0.9, -0.06, 0], atol=1e-9)
    assert rig_edges(CameraMount(0.4, 0.3), shift).shape == (1, 2, 3)
    assert rig_edges(None, shift).shape == rig_edges(mount, None).shape == (0, 2, 3)


def test_the_floor_is_a_square_grid_through_the_origin() -> None:
    lines = floor_lines(2)
    assert lines.shape == (10, 2, 3)
    assert (lines[..., 2] == 0).all()
    lengths = np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1)
    np.testing.assert_array_equal(lengths, 4)
    crossing = [line for line in lines if (line.mean(axis=0) == 0).all()]
    assert len(crossing) == 2
    assert crossing[0][0] @ crossing[1][0] == 0


def test_an_unknown_mount_is_drawn_level() -> None:
    np.testing.assert_allclose(level_pose(None).apply([0, 0, 1]), [1, 0, 0])


def test_a_box_has_twelve_edges_along_its_axes() -> None:
    quarter = Pose.from_rotvec([0, math.pi / 2, 0], [0, 0, 0]).rotation
    edges = box_edges([1, 2, 3], [0.4, 0.6, 1.0], quarter)
    assert edges.shape == (12, 2, 3)
    lengths = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1)
    np.testing.assert_allclose(sorted(lengths), [0.4] * 4 + [0.6] * 4 + [1.0] * 4)
    corners = edges.reshape(-1, 3)
    np.testing.assert_allclose(corners.min(0), [0.5, 1.7, 2.8])
    np.testing.assert_allclose(corners.max(0), [1.5, 2.3, 3.2])


@settings(deadline=None, max_examples=50)
@given(ANGLES, st.floats(0, 0.5))
def test_bodies_are_upright_and_face_their_heading(yaw: float, tilt: float) -> None:
    T = level_pose(CameraMount(0.4, tilt))
    up = T.rotation.T @ np.array([0.0, 0.0, 1.0])
    axes = upright_rotation(yaw, up)
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-9)
    assert np.linalg.det(axes) == pytest.approx(1)
    np.testing.assert_allclose(T.rotate(axes[:, 2]), [0, 0, 1], atol=1e-9)
    # Positive is to the right, which is -y in the display.
    assert math.copysign(1, -T.rotate(axes[:, 0])[1]) == math.copysign(1, yaw) or abs(yaw) < 1e-9


def test_padding_repeats_and_thinning_spreads() -> None:
    rows = np.arange(6).reshape(3, 2)
    np.testing.assert_array_equal(padded(rows, 5)[3:], [[4, 5], [4, 5]])
    np.testing.assert_array_equal(padded(rows, 2), rows[:2])
    for count, most in ((0, 10), (10, 10), (11, 10), (20_000, 500), (999, 1000)):
        assert len(range(count)[thinned(count, most)]) <= most
    assert list(range(10)[thinned(10, 5)]) == [0, 2, 4, 6, 8]


def test_the_scene_follows_a_robot_only_beyond_the_radius() -> None:
    follower = Follower(radius_m=4)
    np.testing.assert_allclose(follower.offset(np.array([3.9, 0, 1])), 0)
    np.testing.assert_allclose(follower.offset(np.array([10.0, 0, 1])), [-6, 0, 0])
    # On the way back it stays until the radius is left on the other side.
    np.testing.assert_allclose(follower.offset(np.array([3.0, 0, 1])), [-6, 0, 0])
    follower.reset()
    np.testing.assert_allclose(follower.offset(np.zeros(3)), 0)


def test_trails_keep_only_moved_points() -> None:
    trails = Trails()
    for k in range(5):
        trails.add_camera(np.array([0.0, 0.0, 0.1 * k]))
        trails.add_camera(np.array([0.0, 0.0, 0.1 * k + 0.001]))
    assert trails.camera.shape == (4, 2, 3)
    trails.add_obstacle(1, np.zeros(3), now=0)
    trails.add_obstacle(1, np.ones(3), now=1)
    trails.add_obstacle(2, np.ones(3), now=1)
    assert trails.obstacles.shape == (1, 2, 3)
    trails.forget_gone(now=100)
    assert trails.obstacles.shape == (0, 2, 3)
    assert trail_segments([]).shape == (0, 2, 3)


# --- the picture --------------------------------------------------------------------------


@pytest.fixture
def observed(peer: Any) -> Any:
    peer.start_process()
    peer._open(OpenSource("simulated:lab", None, {}, 0))
    return peer


def test_a_picture_contains_one_obstacle(observed: Any) -> None:
    event = observed.observe()
    picture = make_picture(event, observed.state(), 1, event.received + 0.1)
    assert picture.segment == (1, 0)
    assert picture.boxes.shape == (1, 12, 2, 3)
    assert picture.truth.shape == (1, 12, 2, 3)
    np.testing.assert_allclose(picture.arrows[0, 1] - picture.arrows[0, 0], [0.4, 0, 0])
    assert [tag.text for tag in picture.tags] == ["#7  0.40 ± 0.10 m/s"]
    # The label stands above the box, which is up in the display and -y in the camera.
    assert picture.tags[0].position[1] < 0
    assert picture.optics == pytest.approx((2 * math.atan(128 / 443), 2.0))
    assert picture.floor_known
    assert not picture.stale


@pytest.mark.parametrize("tilt", [-0.2, 0.0, 0.3])
@pytest.mark.parametrize(("foot", "drawn"), [(0.1, 0.0), (0.6, 0.6), (-0.05, -0.05)])
def test_a_box_is_upright_around_the_body_for_any_camera_tilt(
    observed: Any, tilt: float, foot: float, drawn: float
) -> None:
    """A person of 1.7 m, seen from ``foot`` upwards; the part missing at the feet is added."""
    event = observed.observe()
    mount = CameraMount(0.9, tilt)
    T_world_display = level_pose(mount).inverse()
    height = 1.7 - foot
    event.line["obstacles"][0].update(
        position=T_world_display.apply([3.0, 0.4, foot + height / 2]).tolist(),
        size=[0.5, height, 0.4],
        orientation_wxyz=[1.0, 0.0, 0.0, 0.0],
    )
    state = replace(observed.state(), mount=mount)
    picture = make_picture(event, state, 1, event.received)
    edges = picture.T_display_world.apply(picture.boxes[0].reshape(-1, 3))
    np.testing.assert_allclose(edges.min(axis=0), [2.8, 0.15, drawn], atol=1e-9)
    np.testing.assert_allclose(edges.max(axis=0), [3.2, 0.65, 1.7], atol=1e-9)
    unknown = make_picture(event, replace(state, mount=None), 1, event.received)
    assert np.ptp(unknown.boxes[0].reshape(-1, 3)[:, 1]) == pytest.approx(height)


def test_old_data_are_marked_stale(observed: Any) -> None:
    event = observed.observe()
    state = observed.state()
    old = make_picture(event, state, 1, event.received + 3.2)
    assert old.stale
    paused = replace(state, playback=replace(state.playback, paused=True))
    held = make_picture(event, paused, 1, event.received + 3.2)
    assert not held.stale
    ended = replace(state, playback=replace(state.playback, ended=True))
    assert not make_picture(event, ended, 1, event.received + 3.2).stale
    failed = replace(paused, state=EngineState.FAILED)
    assert make_picture(event, failed, 1, event.received + 0.1).stale
    none = make_picture(None, state, 1, 5.0)
    assert not none.stale
    assert none.boxes.shape == (0, 12, 2, 3)


def test_objects_without_a_world_pose_are_not_drawn(observed: Any) -> None:
    event = observed.observe()
    event.line["pose"] = None
    for name in ("position", "velocity", "orientation_wxyz"):
        event.line["obstacles"][0][name] = None
    picture = make_picture(event, observed.state(), 1, event.received)
    assert picture.T_world_camera is None
    assert len(picture.boxes) == len(picture.arrows) == len(picture.tags) == 0


def test_clouds_are_read_back_as_written(observed: Any) -> None:
    observed.draw_cloud(40)
    value = observed.cloud.read(0)
    assert isinstance(value, Latest)
    cloud = read_cloud(value)
    assert cloud.points.shape == (40, 3)
    assert cloud.colors.shape == (40, 3)
    assert 1 <= cloud.points.min() <= cloud.points.max() <= 3
    np.testing.assert_allclose(cloud.T_world_camera.matrix, np.eye(4))


# --- the observing robot ---------------------------------------------------------------------

_MOUNT = CameraMount(0.4, 0.3, 0.1, 0.06, pan_rad=0.2)
_GUARD = GuardVerdict(
    level="slow",
    reason="obstacle 3 is 1.2 m ahead",
    limit_mps=0.1,
    stop_zone=[(0.5, 0.2), (-0.2, 0.2), (-0.2, -0.2), (0.5, -0.2)],
    slow_zone=[(1.5, 0.3), (-0.2, 0.3), (-0.2, -0.3)],
)
_REPORT = RobotReport(
    RobotPhase.CONNECTED,
    width_m=0.4,
    length_m=0.6,
    received=10.0,
    sonars=(
        SonarReading(0, 0.1, 0.0, 0.0, 1.4, 9.9),
        SonarReading(1, 0.0, 0.1, 1.5, None, 9.9),
        SonarReading(1, 0.0, 0.1, 1.5, 0.8, 8.0),
    ),
)
_GOAL = GoalNow(
    state="driving",
    sentence="Waiting for obstacle 3: it will cross in 1.4 s.",
    place=(3.0, -0.5),
    distance_m=3.04,
    elapsed_s=2.0,
    path=[(0.0, 0.0), (0.5, 0.1), (1.0, 0.1)],
    risk_per_metre=0.001,
    planned_risk_per_metre=0.0002,
    waits_for=3,
    meets_s=1.4,
    meets_at=(0.8, -0.2),
    refused=[
        RefusedPath(0.0, 0.5, ((0.0, 0.0), (0.5, 0.0), (1.0, 0.0)), "risk", 0.04, 3, 1.2),
        RefusedPath(0.5, 0.5, tuple((0.1 * k, 0.05 * k) for k in range(9)), "guard"),
    ],
)
_STILL = Velocity(0.0, 0.0)
_ROBOT = RobotNow(
    "port", "name", "real", "armed", None, False, None, _STILL, _STILL, _GUARD, _REPORT
)


def _in_base(lines: Any, T_world_camera: Pose) -> Any:
    T_base_world = _MOUNT.T_base_camera @ T_world_camera.inverse()
    return T_base_world.apply(np.reshape(lines, (-1, 3))).reshape(-1, 2, 3)


def test_zones_and_outline_are_on_the_floor_around_the_robot() -> None:
    T = Pose.from_rotvec([0.0, 0.4, 0.0], [1.0, 0.0, 2.0])
    marks = robot_marks(_ROBOT, _MOUNT, T)
    assert marks is not None
    zone = _in_base(marks.stop_zone, T)
    np.testing.assert_allclose(zone[:, 0, :2], _GUARD.stop_zone, atol=1e-9)
    np.testing.assert_array_equal(zone[:, 1], np.roll(zone[:, 0], -1, axis=0))
    assert (np.abs(zone[..., 2]) < 0.03).all()
    assert marks.slow_zone.shape == (3, 2, 3)
    outline = _in_base(marks.outline, T)
    np.testing.assert_allclose(np.abs(outline[:4, 0, :2]), [[0.3, 0.2]] * 4, atol=1e-9)
    # The line that points ahead begins at the middle of the axle.
    np.testing.assert_allclose(outline[4, :, :2], [[0.0, 0.0], [0.5, 0.0]], atol=1e-9)
    assert (marks.level, marks.text) == ("slow", "slowed: obstacle 3 is 1.2 m ahead")


def test_only_recent_echoes_are_drawn_at_their_distance() -> None:
    marks = robot_marks(_ROBOT, _MOUNT, Pose.identity())
    assert marks is not None
    ends = _in_base(marks.sonar, Pose.identity())
    assert ends.shape == (3, 2, 3)
    np.testing.assert_allclose(np.linalg.norm(ends[..., :2] - (0.1, 0.0), axis=-1), 1.4)
    wide = robot_marks(
        _ROBOT, _MOUNT, Pose.identity(), limits=GuardParameters(sonar_half_angle_deg=30.0)
    )
    assert wide is not None
    along = _in_base(wide.sonar, Pose.identity())[..., :2] - (0.1, 0.0)
    np.testing.assert_allclose(np.arctan2(*along[[0, -1], [0, -1]].T[::-1]), np.radians([-30, 30]))


def test_a_partly_known_robot_is_drawn_as_far_as_known() -> None:
    assert robot_marks(_ROBOT, None, Pose.identity()) is None
    assert robot_marks(_ROBOT, _MOUNT, None) is None
    assert robot_marks(None, _MOUNT, Pose.identity()) is None
    unknown = replace(_ROBOT, guard=None, report=RobotReport(RobotPhase.CONNECTING))
    marks = robot_marks(unknown, _MOUNT, Pose.identity())
    assert marks is not None
    assert len(marks.outline) == len(marks.stop_zone) == len(marks.sonar) == 0
    assert (marks.level, marks.text) == (None, None)
    around = np.linspace(0, 2 * math.pi, 200, endpoint=False)
    corners = np.stack([np.cos(around), np.sin(around)], 1).tolist()
    many = replace(unknown, guard=replace(_GUARD, stop_zone=corners))
    circle = robot_marks(many, _MOUNT, Pose.identity())
    assert circle is not None
    assert 30 < len(circle.stop_zone) <= MOST_ZONE_LINES


def test_goal_and_path_are_on_the_floor_while_driving_there() -> None:
    T = Pose.from_rotvec([0.0, 0.4, 0.0], [1.0, 0.0, 2.0])
    marks = robot_marks(_ROBOT, _MOUNT, T, _GOAL)
    assert marks is not None
    path = _in_base(marks.path, T)
    np.testing.assert_allclose(path[:, 0, :2], _GOAL.path[:2], atol=1e-9)
    np.testing.assert_allclose(path[:, 1, :2], _GOAL.path[1:], atol=1e-9)
    assert (np.abs(path[..., 2]) < 0.03).all()
    goal = _in_base(marks.goal, T)
    assert len(goal) == GOAL_LINES
    # Within the ring the goal counts as reached; the flag stands at its centre.
    ring, pole = goal[:-3], goal[-3]
    np.testing.assert_allclose(
        np.linalg.norm(ring[..., :2] - np.array(_GOAL.place), axis=-1), 0.25, atol=1e-9
    )
    np.testing.assert_allclose(pole[:, :2], [_GOAL.place] * 2, atol=1e-9)
    np.testing.assert_allclose(
        _in_base([marks.T_world_base.translation] * 2, T)[0], np.zeros((2, 3)), atol=1e-9
    )
    for over in (None, replace(_GOAL, state="reached"), replace(_GOAL, place=None, path=[])):
        nothing = robot_marks(_ROBOT, _MOUNT, T, over)
        assert nothing is not None
        assert len(nothing.path) == len(nothing.goal) == 0
        if over is None or over.state != "driving":
            assert len(nothing.refused) == len(nothing.meeting) == 0


def test_refused_paths_and_the_predicted_meeting_are_on_the_floor() -> None:
    T = Pose.from_rotvec([0.0, 0.4, 0.0], [1.0, 0.0, 2.0])
    marks = robot_marks(_ROBOT, _MOUNT, T, _GOAL)
    assert marks is not None
    refused, meeting = _in_base(marks.refused, T), _in_base(marks.meeting, T)
    # Short paths are drawn as reported, long ones thinned out up to their end.
    np.testing.assert_allclose(refused[:2, 1, :2], _GOAL.refused[0].path[1:], atol=1e-9)
    np.testing.assert_allclose(refused[-1, 1, :2], _GOAL.refused[1].path[-1], atol=1e-9)
    assert 2 < len(refused) <= MOST_REFUSED_LINES
    assert len(meeting) == MEETING_LINES
    off = np.linalg.norm(meeting[..., :2] - np.array(_GOAL.meets_at), axis=-1)
    np.testing.assert_allclose(off, 0.3, atol=1e-9)
    assert (np.abs(np.concatenate([refused, meeting])[..., 2]) < 0.03).all()
    many = replace(_GOAL, refused=[*_GOAL.refused] * 9)
    crowded = robot_marks(_ROBOT, _MOUNT, T, many)
    assert crowded is not None
    assert len(crowded.refused) <= MOST_REFUSED_LINES


def test_a_long_path_keeps_its_end() -> None:
    places = [(0.01 * k, 0.0) for k in range(250)]
    marks = robot_marks(_ROBOT, _MOUNT, Pose.identity(), replace(_GOAL, path=places))
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
    robot = replace(_ROBOT, guard=replace(_GUARD, level=level))
    goal = replace(_GOAL, waits_for=waits_for)
    marks = robot_marks(robot, _MOUNT, Pose.identity(), goal)
    assert marks is not None
    assert marks.text == text
    unguarded = robot_marks(replace(robot, guard=None), _MOUNT, Pose.identity(), goal)
    assert unguarded is not None
    assert unguarded.text == (None if waits_for is None else goal.sentence)


def test_the_robot_comes_from_the_drive_process(observed: Any) -> None:
    event, state = observed.observe(), observed.state()
    robots: Any = {"observer": _ROBOT, "obstacle": None}
    told = RobotsNow(
        *(None, None, None, None, _GOAL, robots),
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


# --- viser's nodes --------------------------------------------------------------------------


async def test_the_scene_reuses_its_nodes_and_hides_a_stale_robot_pose(
    peer: Any, drive: Any, storage: Storage, capsys: Any
) -> None:
    async def watch(viewer: ViserViewer) -> None:
        scene = viewer._scene
        handles = dict(viewer._viser.server.scene._handle_from_node_name)
        with viewer.connected():
            while "cloud" not in peer.watched:
                await asyncio.sleep(0.005)
            for _ in range(5):
                peer.observe()
                await asyncio.sleep(0.06)
            assert scene._cloud.visible
            assert scene._cloud.points.shape == (300, 3)
            assert scene._obstacles.boxes.visible
            assert scene._obstacles.boxes.points.shape == (16 * 12, 2, 3)
            assert scene._obstacles.labels[0].visible
            assert scene._obstacles.labels[0].text.startswith("#7  0.40")
            assert not scene._obstacles.labels[1].visible
            assert scene._camera._image_data == peer.views["plain"].read(0).payload
            assert not scene._robot.outline.visible
            assert not scene._map.visible
            cells = OccupancyMap.of(np.ones((9, 9), np.uint8), (0.0, 0.0), 0.1, (0.0,) * 3, 0.0)
            for local_map in (LocalMapEvent(cells, Pose.identity()), LocalMapEvent(None, None)):
                peer.publish(local_map)
                while scene._map.visible != (local_map.map is not None):
                    peer.observe()
                    await asyncio.sleep(0.03)
            assert scene._map.scale == pytest.approx(0.9)
            robots: Any = {"observer": _ROBOT, "obstacle": None}
            drive.publish(DriveState(DriveFacts(None, None, None, None, None, robots), 0.0))
            while not scene._robot.outline.visible:
                peer.observe()
                await asyncio.sleep(0.03)
            assert scene._robot.base.visible
            assert not scene._robot.path.visible
            drive.publish(DriveState(DriveFacts(None, None, None, None, _GOAL, robots), 0.0))
            while not scene._robot.goal.visible:
                peer.observe()
                await asyncio.sleep(0.03)
            assert scene._robot.path.points.shape == (MOST_PATH_LINES, 2, 3)
            assert scene._robot.reason.text == _GOAL.sentence
            drive.publish(DriveState(DriveFacts(None, None, None, None, None, robots), 0.0))
            while scene._robot.goal.visible:
                peer.observe()
                await asyncio.sleep(0.03)
            assert scene._robot.stop_zone.points.shape == (MOST_ZONE_LINES, 2, 3)
            assert scene._robot.slow_zone.visible
            assert scene._robot.sonar.visible
            assert scene._robot.reason.text == "slowed: obstacle 3 is 1.2 m ahead"
            peer.lose()
            while scene._robot.outline.visible:
                await asyncio.sleep(0.01)
            assert not scene._robot.reason.visible
            assert not scene._robot.base.visible
            # The page, not the scene, says that it is old.
            assert scene._cloud.visible
            peer.start_process()
            while not scene._robot.outline.visible:
                if peer.opened is not None:
                    peer.observe()
                await asyncio.sleep(0.03)
        assert viewer._viser.server.scene._handle_from_node_name == handles

    server = Server(peer, storage, source="simulated:lab", drive=drive)
    viewer = None
    try:
        await server.start()
        while server.source.state.state is EngineState.IDLE:
            await asyncio.sleep(0.005)
        viewer = await asyncio.to_thread(ViserViewer, server, points=300, rate_hz=20)
        await watch(viewer)
    finally:
        if viewer is not None:
            await asyncio.to_thread(viewer.stop)
        await server.stop()
    assert "viser" not in capsys.readouterr().out
