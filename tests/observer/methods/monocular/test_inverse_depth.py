from __future__ import annotations

import numpy as np
import pytest

from observer.camera import StereoCamera
from observer.geometry import Pose
from observer.methods.monocular.ground import GroundPlane
from observer.methods.monocular.inverse_depth import (
    anchored_anew,
    expected_sightings,
    lines_of_sight,
    updated,
)
from observer.methods.monocular.pose import estimate_pose
from observer.methods.monocular.rays import RayPoints
from observer.mount import CameraMount

CAMERA = StereoCamera(512, 256, 443.0, 443.0, 255.5, 127.5, 0.12)
RNG = np.random.default_rng(4)
PLACES = np.column_stack([
    RNG.uniform(-2, 2, 120), RNG.uniform(-0.8, 0.35, 120), RNG.uniform(2, 6, 120)
])  # fmt: skip


def seen_from(T_camera_world: Pose, noise: float = 0.0, seed: int = 0) -> np.ndarray:
    px = CAMERA.project(T_camera_world.apply(PLACES))[0]
    px = px + noise * np.random.default_rng(seed).standard_normal(px.shape)
    return px.astype(np.float32)


def first_seen() -> RayPoints:
    px = seen_from(Pose.identity())
    ray = lines_of_sight(px, Pose.identity(), CAMERA)
    return RayPoints.begin(px, np.zeros(3), ray, np.full(120, 0.4), np.full(120, 0.36))


def moved(distance: float) -> Pose:
    return Pose(np.eye(3), np.array([-distance, 0.0, 0.0]))


def travelled(steps: int, noise: float = 0.05) -> RayPoints:
    points = first_seen().but(sigma_px=np.full(120, noise))
    for k in range(1, steps + 1):
        points = points.but(
            px=seen_from(moved(0.02 * k), noise, k), anchor_s=points.anchor_s + 0.07
        )
        points = updated(points, moved(0.02 * k), 1e-10 * np.eye(6), 1.0, CAMERA)
    return points


def test_sideways_travel_gives_every_depth_with_its_stated_uncertainty() -> None:
    points = travelled(12)
    true = 1 / np.linalg.norm(PLACES, axis=1)
    error = (points.inverse - true) / np.sqrt(points.variance)
    assert points.known.all()
    assert np.abs(points.inverse / true - 1).max() < 0.1
    assert 0.2 < np.std(error) < 1.5


def test_no_depth_is_known_without_travel() -> None:
    points = first_seen()
    turned = Pose.from_rotvec([0.0, 0.1, 0.0], np.zeros(3))
    points = updated(points.but(px=seen_from(turned)), turned, 1e-10 * np.eye(6), 1.0, CAMERA)
    np.testing.assert_allclose(points.variance, 0.36)
    assert not points.known.any()
    np.testing.assert_allclose(points.residual, 0, atol=1e-3)


def test_moving_points_leave_a_residual_across_their_line() -> None:
    points = travelled(6)
    px = points.px.copy()
    px[:10, 1] += 3
    points = updated(points.but(px=px), moved(0.12), 1e-10 * np.eye(6), 1.0, CAMERA)
    assert (np.abs(points.residual[:10, 1]) > 2.5).all()
    assert np.abs(points.residual[10:, 1]).max() < 0.5


def test_reanchoring_preserves_position_and_uncertainty() -> None:
    points = travelled(12)
    T = moved(0.24)
    again = anchored_anew(points, np.ones(120, np.bool_), T.inverse(), CAMERA)
    np.testing.assert_allclose(again.place(), points.place(), atol=0.01)
    np.testing.assert_allclose(again.centre, np.broadcast_to((0.24, 0, 0), (120, 3)))
    share = np.sqrt(again.variance) / again.inverse / (np.sqrt(points.variance) / points.inverse)
    np.testing.assert_allclose(share, 1, atol=0.1)
    np.testing.assert_allclose(expected_sightings(again, T, CAMERA).px, again.px, atol=1e-3)


def test_the_pose_is_found_from_known_depths_despite_moving_points() -> None:
    points = travelled(12)
    T = Pose.from_rotvec([0.002, 0.03, 0.0], [-0.26, 0.0, -0.02])
    px = seen_from(T, 0.05, 99)
    px[:25] += (6.0, 0.0)
    prior = np.diag([1 / 0.02**2] * 3 + [1 / 0.03**2] * 3)
    estimate = estimate_pose(
        points.but(px=px), np.ones(120, np.bool_), np.ones(120), moved(0.25), prior, None, 0.02,
        CAMERA,
    )  # fmt: skip
    assert np.linalg.norm(estimate.T_camera_world.translation - T.translation) < 0.01
    assert np.linalg.norm((estimate.T_camera_world @ T.inverse()).rotvec) < 0.003
    assert estimate.inliers[:25].sum() <= 2
    assert estimate.inliers[25:].mean() > 0.9


def test_the_mount_constrains_height_and_tilt() -> None:
    mount = CameraMount(0.4, 0.1)
    nothing = np.zeros(120, np.bool_)
    start = Pose.from_rotvec([0.03, 0.0, 0.0], [0.0, 0.05, 0.0])
    ground = GroundPlane.below(mount)
    estimate = estimate_pose(
        first_seen(), nothing, np.ones(120), start, 1.0 * np.eye(6), ground, 0.0, CAMERA
    )
    pose = estimate.T_camera_world
    height = ground.height_of(pose.inverse().translation)
    assert height == pytest.approx(0.4, abs=1e-3)
    np.testing.assert_allclose(pose.rotate(mount.down), mount.down, atol=1e-3)
