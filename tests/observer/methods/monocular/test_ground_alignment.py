"""The camera's motion from images of a tiled ground that is drawn pixel by pixel."""

from __future__ import annotations

import numpy as np
import pytest

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.methods.monocular.ground import GroundPlane
from observer.methods.monocular.ground_alignment import GroundMark, GroundMotion
from observer.methods.monocular.ground_odometry import GroundFollower, GroundOdometer
from observer.methods.monocular.initialization import Initialization, initialize_over_ground
from observer.methods.monocular.inverse_depth import lines_of_sight
from observer.methods.monocular.rays import RayPoints
from observer.mount import CameraMount
from observer.types import Image

CAMERA = StereoCamera(256, 192, 220.0, 220.0, 127.5, 95.5, 0.12)
TILE_M = 0.4


def ground_of(height: float, tilt_deg: float) -> GroundPlane:
    return GroundPlane.below(CameraMount(height, float(np.radians(tilt_deg))))


def drawn(ground: GroundPlane, T_camera_first: Pose, contrast: float = 30.0) -> Image:
    """(192, 256) plain grey tiles with dark joints 1 cm wide, averaged over 4 x 4 rays a pixel."""
    shades = np.zeros((CAMERA.height, CAMERA.width))
    T_first_camera = T_camera_first.inverse()
    for shift in (np.arange(16)[:, None] // [4, 1] % 4 - 1.5) / 4:
        v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width] + shift[:, None, None]
        ray = np.stack(
            [(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], axis=2
        )
        ray = T_first_camera.rotate(ray.reshape(-1, 3))
        slope = ray @ ground.down
        height = float(ground.height_of(T_first_camera.translation))
        seen = slope > 0.01
        place = T_first_camera.translation + ray * (height / np.where(seen, slope, 1))[:, None]
        gap = np.abs((place @ ground.axes + 0.13) % TILE_M - TILE_M / 2)
        joint = seen & (gap > TILE_M / 2 - 0.005).any(axis=1)
        shades += joint.reshape(shades.shape) / 16
    place_mm = int(1e4 * float(np.abs(T_camera_first.translation).sum()))
    noise = np.random.default_rng(place_mm).normal(0, 1.0, shades.shape)
    return np.clip(np.rint(150 - contrast * shades + noise), 0, 255).astype(np.uint8)


def driven(ground: GroundPlane, ahead: float, turn_deg: float = 0.0) -> Pose:
    """T_now_first of a camera that keeps its height and tilt."""
    turn = Pose.from_rotvec(np.radians(turn_deg) * ground.down, np.zeros(3))
    return (Pose(np.eye(3), ahead * ground.axes[:, 1]) @ turn).inverse()


def wrong_guess(T: Pose, ground: GroundPlane, metres: Float64Array) -> Pose:
    return Pose(T.rotation, T.translation + ground.axes @ metres)


@pytest.mark.parametrize(("height", "tilt"), [(0.25, 10.0), (0.5, 15.0), (0.9, 25.0)])
@pytest.mark.parametrize("turn", [0.0, 4.0])
def test_joints_give_the_distance_to_three_percent(height: float, tilt: float, turn: float) -> None:
    ground = ground_of(height, tilt)
    T = driven(ground, 0.12, turn)
    mark = GroundMark(drawn(ground, Pose.identity()), ground, CAMERA)
    guess = wrong_guess(T, ground, np.array([0.004, -0.012]))
    seen = mark.aligned(drawn(ground, T), guess, 0.003)
    assert seen is not None
    assert seen.distance_m == pytest.approx(0.12, rel=0.03)
    assert 0 < seen.distance_sigma < 0.06
    gap = seen.T_now_mark.translation - T.translation
    assert np.linalg.norm(gap) < 0.006


def test_a_bare_ground_gives_no_distance() -> None:
    ground = ground_of(0.5, 15.0)
    T = driven(ground, 0.1)
    mark = GroundMark(drawn(ground, Pose.identity(), 0.0), ground, CAMERA)
    assert mark.aligned(drawn(ground, T, 0.0), T, 0.003) is None


def test_a_different_ground_gives_no_distance() -> None:
    ground = ground_of(0.5, 15.0)
    T = driven(ground, 0.1)
    mark = GroundMark(drawn(ground, Pose.identity()), ground, CAMERA)
    other = np.ascontiguousarray(drawn(ground, driven(ground, 0.31, 25.0)))
    assert mark.aligned(other, T, 0.003) is None


def test_the_ground_is_followed_from_the_first_view() -> None:
    ground = ground_of(0.5, 15.0)
    follower = GroundFollower(drawn(ground, Pose.identity()), ground, CAMERA)
    measurements = [
        follower.followed(drawn(ground, driven(ground, distance)), np.eye(3), 0.01)
        for distance in (0.01, 0.025, 0.04, 0.06)
    ]
    assert measurements[-1] is not None
    assert measurements[-1].distance_m == pytest.approx(0.06, rel=0.04)
    assert follower.followed(drawn(ground, driven(ground, 0.07)), np.eye(3), 0.0) is None


def test_the_scale_error_of_a_map_is_measured_once_per_mark() -> None:
    ground = ground_of(0.5, 15.0)
    odometer = GroundOdometer(drawn(ground, Pose.identity()), Pose.identity(), ground, CAMERA)
    now = drawn(ground, driven(ground, 0.13))
    by_map = driven(ground, 0.13 * 1.08)
    assert odometer.measured(now, by_map, 1e-6 * np.eye(6)) is not None
    assert odometer.sees
    measurement = odometer.compared(now, by_map)
    assert measurement is not None
    assert measurement[0] == pytest.approx(-np.log(1.08), abs=0.03)
    assert odometer.compared(now, by_map) is None


def test_motion_that_contradicts_the_points_is_not_taken_for_the_ground() -> None:
    ground = ground_of(0.5, 15.0)
    odometer = GroundOdometer(drawn(ground, Pose.identity()), Pose.identity(), ground, CAMERA)
    # According to the points, the camera certainly stands still.
    now = drawn(ground, driven(ground, 0.025))
    assert odometer.measured(now, Pose.identity(), 1e-8 * np.eye(6)) is None
    assert not odometer.sees


def initialized(true_ahead: float, told_ahead: float) -> Initialization | None:
    """The initialization over the ground with 150 points 2 to 5 m away."""
    ground = ground_of(0.5, 15.0)
    rng = np.random.default_rng(8)
    px = (rng.uniform(0, 1, (150, 2)) * [256, 192]).astype(np.float32)
    first = lines_of_sight(px, Pose.identity(), CAMERA)
    place = first * rng.uniform(2, 5, (150, 1))
    seen = driven(ground, true_ahead).apply(place)
    later = CAMERA.project(seen)[0] + rng.normal(0, 0.1, (150, 2))
    points = RayPoints.begin(px, np.zeros(3), first, np.full(150, 0.2), np.full(150, 0.25))
    points = points.but(px=later.astype(np.float32), sigma_px=np.full(150, 0.1))
    now = lines_of_sight(points.px, Pose.identity(), CAMERA)
    motion = GroundMotion(driven(ground, told_ahead), np.diag([1e-6] * 3 + [2e-6] * 3))
    return initialize_over_ground(points, first, now, motion, CAMERA)


def test_points_start_with_depth_from_the_distance_measured_on_the_ground() -> None:
    start = initialized(0.1, 0.1)
    assert start is not None
    assert np.linalg.norm(start.T_now_first.translation) == pytest.approx(0.1, rel=0.05)
    sure = start.points.variance < 0.03**2
    assert sure.sum() > 20
    assert np.all(np.abs(1 / start.points.inverse[sure] - 3.5) < 2.5)


def test_a_robot_driving_ahead_is_not_taken_for_the_ground() -> None:
    # A robot covers the ground and drives faster: relative to it the camera moves backwards.
    assert initialized(0.1, -0.1) is None


def test_too_short_a_distance_initializes_nothing() -> None:
    assert initialized(0.02, 0.02) is None
