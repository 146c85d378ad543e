"""Shapes, trails and the upright frame of the 3D scene, by construction."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

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
from observer.mount import CameraMount, level_pose

ANGLES = st.floats(-1.4, 1.4)


def test_a_level_camera_looks_along_x_at_its_height() -> None:
    T = level_pose(CameraMount(0.4, 0.0))
    np.testing.assert_allclose(T.apply([0, 0, 2]), [2, 0, 0.4], atol=1e-12)
    np.testing.assert_allclose(T.apply([1, 0, 0]), [0, -1, 0.4], atol=1e-12)
    np.testing.assert_allclose(T.apply([0, 0.4, 0]), [0, 0, 0], atol=1e-12)


@settings(max_examples=50)
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


@settings(max_examples=50)
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
