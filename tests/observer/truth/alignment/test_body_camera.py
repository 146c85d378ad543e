"""Where the camera sits on its body, as far as the drive determines it."""

from __future__ import annotations

import numpy as np
import pytest

from observer.errors import NotObservable
from observer.geometry import Float64Array, Pose
from observer.truth.alignment.body_camera import Assumed, find_body_camera

T_BODY_CAMERA = Pose.from_rotvec([0, 0, 0.4], [0.15, -0.1, 0.25]) @ Pose(
    np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]), np.zeros(3)
)
T_WORLD_ROOM = Pose(np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]), np.zeros(3)) @ (
    Pose.from_rotvec([0, 0, 2.2], [1.5, -0.7, -0.6])
)
UP = T_WORLD_ROOM.rotation[:, 2]


def poses(
    heading: Float64Array, place: Float64Array, lean: float = 0.0, seed: int = 0
) -> tuple[Float64Array, Float64Array]:
    """Return camera and body poses (N, 4, 4), with noise of visual odometry and motion capture."""
    rng = np.random.default_rng(seed)
    camera, body = [], []
    for k, (h, p) in enumerate(zip(heading, place, strict=True)):
        tipped = Pose.from_rotvec([lean * np.sin(k / 9), lean * np.cos(k / 7), 0], np.zeros(3))
        T_room_body = Pose.from_rotvec([0, 0, h], [*p, 0.3]) @ tipped
        noise = Pose.from_rotvec(rng.normal(0, 0.002, 3), rng.normal(0, 0.002, 3))
        camera.append((T_WORLD_ROOM @ T_room_body @ T_BODY_CAMERA @ noise).matrix)
        body.append(T_room_body.matrix)
    return np.array(camera), np.array(body)


def arc() -> tuple[Float64Array, Float64Array]:
    """Turn left, then right: a single circle would leave the rotation about its centre open."""
    h = np.r_[np.linspace(0, 1.2, 75), np.linspace(1.2, -0.2, 75)]
    return h, np.cumsum(0.015 * np.column_stack([np.cos(h), np.sin(h)]), axis=0)


def test_arc_on_the_floor_determines_all_but_the_height() -> None:
    camera, body = poses(*arc())
    found = find_body_camera(camera, body, Assumed(up_world=UP))
    apart = found.T_body_camera.translation - T_BODY_CAMERA.translation
    assert np.abs(apart[:2]).max() < 0.01
    assert found.observed == (True, True, False, True, True, True)
    turned = found.T_body_camera.rotation.T @ T_BODY_CAMERA.rotation
    assert np.degrees(np.arccos((np.trace(turned) - 1) / 2)) < 1.0
    assert found.residual_m < 0.01
    assert found.notes == (
        "Camera position on the body: planar motion does not determine height; the body's own is "
        "assumed.",
    )


def test_height_comes_from_the_mount_or_the_given_pose() -> None:
    camera, body = poses(*arc())
    by_mount = find_body_camera(camera, body, Assumed(up_world=UP, camera_height_m=0.55))
    assert by_mount.T_body_camera.translation[2] == pytest.approx(0.25, abs=0.01)
    assert "the height of the mount" in by_mount.notes[0]
    by_rig = find_body_camera(camera, body, Assumed(up_world=UP, T_body_camera=T_BODY_CAMERA))
    np.testing.assert_allclose(by_rig.T_world_room.matrix, T_WORLD_ROOM.matrix, atol=0.02)
    assert "the given value is used" in by_rig.notes[0]


def test_motion_in_all_directions_determines_everything() -> None:
    camera, body = poses(*arc(), lean=0.5)
    found = find_body_camera(camera, body)
    assert all(found.observed)
    assert found.notes == ()
    np.testing.assert_allclose(found.T_body_camera.matrix, T_BODY_CAMERA.matrix, atol=0.02)
    np.testing.assert_allclose(found.T_world_room.matrix, T_WORLD_ROOM.matrix, atol=0.03)


def test_straight_drive_determines_directions_but_no_offset() -> None:
    path = np.column_stack([np.linspace(0, 1.5, 100), np.zeros(100)])
    camera, body = poses(np.zeros(100), path)
    found = find_body_camera(camera, body, Assumed(up_world=UP))
    assert found.observed[:3] == (False, False, False)
    assert found.observed[5]
    forward = T_WORLD_ROOM.rotate([1, 0, 0])
    assert found.T_world_room.rotate([1, 0, 0]) @ forward > np.cos(np.radians(1))
    assert "moved too little to determine x, y, height" in found.notes[0]


def test_too_short_a_drive_needs_obstacles_for_the_yaw() -> None:
    still = np.zeros((60, 2))
    camera, body = poses(np.zeros(60), still)
    assert not find_body_camera(camera, body, Assumed(up_world=UP)).observed[5]
    room = np.column_stack([np.linspace(1, 3, 60), np.linspace(-1, 2, 60), np.zeros(60)])
    seen = T_WORLD_ROOM.apply(room)
    found = find_body_camera(camera, body, Assumed(up_world=UP), (seen, room))
    forward = T_WORLD_ROOM.rotate([1, 0, 0])
    assert found.T_world_room.rotate([1, 0, 0]) @ forward > np.cos(np.radians(8))


def test_gaps_are_ignored_and_too_few_poses_refused() -> None:
    camera, body = poses(*arc())
    body[10:60] = np.nan
    assert find_body_camera(camera, body, Assumed(up_world=UP)).residual_m < 0.01
    body[3:] = np.nan
    with pytest.raises(NotObservable, match="in only 3 frames"):
        find_body_camera(camera, body)
