"""From image displacements to velocities, exactly by geometry."""

from __future__ import annotations

import numpy as np
import pytest

from observer.camera import StereoCamera
from observer.geometry import Pose, map_pixels
from observer.methods.planar.clustering import detect_obstacles
from observer.methods.planar.ego_motion import PlanarEgoMotion
from observer.methods.planar.motion import measure_motion
from observer.methods.planar.results import ResidualFlow
from observer.parameters import Parameters
from observer.types import Status

CAMERA = StereoCamera(512, 256, 443.0, 443.0, 255.5, 127.5, 0.12)
POSE_COVARIANCE = np.diag([1e-8, 1e-8, 1e-8, 1e-6, 1e-6, 1e-6])
AFFINE = np.array([[1.02, 0.0, 2.0], [0.0, 1.02, -3.0], [0, 0, 1]])


def ego(H: np.ndarray | None, pose: Pose | None = None) -> PlanarEgoMotion:
    return PlanarEgoMotion(
        model="affine",
        status=Status.OK,
        reasons=(),
        inliers=np.ones(0, bool),
        covariance=None,
        homography=H,
        T_current_previous=pose,
        pose_covariance=None if pose is None else POSE_COVARIANCE,
        residual_rms_px=0.1,
    )


def all_dynamic(before: np.ndarray, after: np.ndarray) -> ResidualFlow:
    flags = np.ones(len(before), bool)
    return ResidualFlow(before.astype(np.float32), after.astype(np.float32), flags)


def displaced(
    points: np.ndarray, velocity: np.ndarray, dt: float
) -> tuple[ResidualFlow, np.ndarray, np.ndarray]:
    """The flow and disparities of moving points, seen by a static camera."""
    px, d = CAMERA.project(points)
    px_after, d_after = CAMERA.project(points + velocity * dt)
    return all_dynamic(px, px_after), d, d_after


@pytest.mark.parametrize("dt", [1 / 30, 0.0667, 0.3])
def test_velocity_is_displacement_over_the_measured_dt(dt: float) -> None:
    points = np.array([[0.1, 0.2, 2.0], [-0.5, 0.0, 3.0], [0.6, -0.3, 1.2]])
    velocity = np.array([0.4, -0.1, 0.3])
    flow, d, d_after = displaced(points, velocity, dt)
    motions = measure_motion(flow, d, d_after, dt, ego(np.eye(3)), CAMERA, Parameters())
    np.testing.assert_allclose(motions.velocity, np.tile(velocity, (3, 1)), atol=1e-4)
    np.testing.assert_allclose(motions.points_previous, points, atol=1e-5)
    np.testing.assert_allclose(motions.points_current, points + velocity * dt, atol=1e-5)
    np.testing.assert_allclose(motions.points_camera, points + velocity * dt, atol=1e-5)


def test_only_dynamic_points_with_depth_within_limits_are_measured() -> None:
    points = np.array([[0, 0, 2.0], [0, 0, 2.0], [0, 0, 2.0], [0, 0, 2.0], [0, 0, 2.0]])
    flow, d, d_after = displaced(points, np.array([0.3, 0, 0]), 0.1)
    flow.dynamic[0] = False
    d, d_after = d[1:], d_after[1:]  # only those of the dynamic points
    d[0] = np.nan
    d_after[1] = np.nan
    d[2] = d_after[2] = 0.5  # 106 m
    motions = measure_motion(flow, d, d_after, 0.1, ego(np.eye(3)), CAMERA, Parameters())
    assert len(motions.velocity) == 1
    slow = Parameters().changed({"motion.max_speed_mps": 0.2})
    measured = measure_motion(flow, d, d_after, 0.1, ego(np.eye(3)), CAMERA, slow)
    assert len(measured.velocity) == 0


def test_current_points_are_where_the_current_camera_sees_them() -> None:
    """The transformed pair's coordinates are mapped back to the pair that was really seen."""
    point_now = np.array([[0.3, -0.2, 2.5]])
    px_now, d_now = CAMERA.project(point_now)
    right_now = px_now - [[d_now[0], 0]]
    inverse = np.linalg.inv(AFFINE)
    left, right = map_pixels(inverse, px_now), map_pixels(inverse, right_now)
    flow = all_dynamic(left + 5, left)
    d_transformed = left[:, 0] - right[:, 0]
    motions = measure_motion(
        flow, d_transformed, d_transformed, 0.1, ego(AFFINE), CAMERA, Parameters()
    )
    np.testing.assert_allclose(motions.points_camera, point_now, atol=1e-4)
    np.testing.assert_allclose(motions.px_current, px_now, atol=1e-3)


def test_the_covariance_matches_the_scatter_of_noisy_measurements() -> None:
    rng = np.random.default_rng(0)
    count, dt = 4000, 0.1
    sigma_px, sigma_d = 0.15, 0.35
    parameters = Parameters().changed(
        {"motion.pixel_sigma_px": sigma_px, "motion.disparity_sigma_px": sigma_d}
    )
    points = np.tile([[0.3, 0.1, 2.0]], (count, 1))
    px, d = CAMERA.project(points)
    flow = all_dynamic(px, px + rng.normal(0, sigma_px, px.shape))
    noise = rng.normal(0, sigma_d, (2, count))
    motions = measure_motion(
        flow, d + noise[0], d + noise[1], dt, ego(np.eye(3)), CAMERA, parameters
    )
    scatter = np.cov(motions.velocity.T)
    stated = np.median(motions.velocity_cov, axis=0)
    np.testing.assert_allclose(np.sqrt(np.diag(scatter)), np.sqrt(np.diag(stated)), rtol=0.06)
    np.testing.assert_allclose(scatter, stated, atol=0.07 * np.abs(scatter).max())


def test_the_model_error_is_the_velocity_a_static_point_would_show() -> None:
    """The camera drives ahead; the affine map fits a wall at 3 m, the point stands at 1.5 m."""
    ahead = 0.05
    pose = Pose(np.eye(3), np.array([0, 0, -ahead]))
    scale = 3.0 / (3.0 - ahead)
    centre = np.array([CAMERA.cx, CAMERA.cy])
    H = np.eye(3)
    H[0, 0] = H[1, 1] = scale
    H[:2, 2] = centre * (1 - scale)
    dt = 0.1
    for depth in (3.0, 1.5):
        point = np.array([[0.4, 0.2, depth]])
        px, d = CAMERA.project(point)
        px_now, d_now = CAMERA.project(pose.apply(point))
        inverse = np.linalg.inv(H)
        left = map_pixels(inverse, px_now)
        right = map_pixels(inverse, px_now - [[d_now[0], 0]])
        flow = all_dynamic(px, left)
        motions = measure_motion(
            flow, d, left[:, 0] - right[:, 0], dt, ego(H, pose), CAMERA, Parameters()
        )
        np.testing.assert_allclose(motions.velocity, motions.model_error, atol=2e-4)
        error = np.linalg.norm(motions.model_error)
        assert error < 1e-6 if depth == 3.0 else error > 0.1


def test_a_receding_obstacle_recedes_for_the_turned_camera_too() -> None:
    """The camera turns at 1 rad/s, and the homography is exactly its rotation."""
    dt, velocity = 0.133, np.array([0.0, 0.0, 0.6])
    pose = Pose.from_rotvec([0.0, -dt, 0.0], np.zeros(3))
    K = np.array([[CAMERA.fx, 0, CAMERA.cx], [0, CAMERA.fy, CAMERA.cy], [0, 0, 1]])
    H = K @ pose.rotation @ np.linalg.inv(K)
    u, v = np.meshgrid(np.linspace(-0.15, 0.15, 4), np.linspace(-0.15, 0.15, 4))
    points = np.column_stack([u.ravel(), v.ravel(), np.full(16, 2.0)])
    px, d = CAMERA.project(points)
    px_now, d_now = CAMERA.project(pose.apply(points + velocity * dt))
    right = px_now - np.column_stack([d_now, np.zeros(16)])
    back = np.linalg.inv(H)
    after, right = map_pixels(back, px_now), map_pixels(back, right)
    flow, d_after = all_dynamic(px, after), after[:, 0] - right[:, 0]
    p = Parameters()
    motions = measure_motion(flow, d, d_after, dt, ego(H, pose), CAMERA, p)
    (found,) = detect_obstacles(motions, dt / 2, p.clustering, p.motion)
    true = pose.rotate(velocity)
    cosine = found.velocity @ true / np.linalg.norm(found.velocity) / np.linalg.norm(true)
    assert np.degrees(np.arccos(min(cosine, 1.0))) < 1.0


def test_the_model_error_is_unknown_without_a_pose() -> None:
    flow, d, d_after = displaced(np.array([[0, 0, 2.0]]), np.array([0.3, 0, 0]), 0.1)
    motions = measure_motion(flow, d, d_after, 0.1, ego(np.eye(3)), CAMERA, Parameters())
    assert np.isnan(motions.model_error).all()


def test_no_dynamic_points_give_no_motion_and_a_lost_motion_is_an_error() -> None:
    none = all_dynamic(np.empty((0, 2)), np.empty((0, 2)))
    empty = np.empty(0)
    motions = measure_motion(none, empty, empty, 0.1, ego(np.eye(3)), CAMERA, Parameters())
    assert len(motions.velocity) == 0
    assert motions.velocity_cov.shape == (0, 3, 3)
    with pytest.raises(ValueError, match="lost"):
        measure_motion(none, empty, empty, 0.1, ego(None), CAMERA, Parameters())


def test_the_pose_covariance_propagates_to_the_model_error() -> None:
    """A sideways camera uncertainty of 1 mm gives 1 mm of displacement at any depth."""
    point = np.array([[0.4, 0.2, 2.5]])
    flow, d, d_after = displaced(point, np.array([0.3, 0, 0]), 0.1)
    pose = Pose.identity()
    motions = measure_motion(flow, d, d_after, 0.1, ego(np.eye(3), pose), CAMERA, Parameters())
    rng = np.random.default_rng(0)
    errors = rng.multivariate_normal(np.zeros(6), POSE_COVARIANCE, 4000)
    seen = [Pose.from_rotvec(e[:3], e[3:]).apply(point[0]) for e in errors]
    scatter = np.cov(np.array(seen).T) / 0.1**2
    np.testing.assert_allclose(
        motions.model_error_cov[0], scatter, atol=0.08 * np.abs(scatter).max()
    )
