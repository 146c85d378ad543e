"""What a lasting error of the disparity makes of the camera's motion."""

import numpy as np
import pytest

from observer.camera import StereoCamera
from observer.camera_rate import CameraRate
from observer.geometry import Pose


@pytest.fixture
def camera() -> StereoCamera:
    return StereoCamera(
        width=1242, height=375, fx=721.0, fy=721.0, cx=610.0, cy=173.0, baseline=0.54
    )


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (0.05, -0.4, 0.1)])
@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.0), (0.5, 0.1, -9.0)])
def test_a_wrong_disparity_moves_points_as_stated(
    camera: StereoCamera, turn: tuple[float, ...], velocity: tuple[float, ...]
) -> None:
    """Against finite differences: triangulated with a disparity that stays wrong by a little."""
    place = np.array([[-20.0, 1.0, 30.0], [0.5, -0.3, 3.0], [4.0, 0.0, 60.0]])
    own = np.broadcast_to(velocity, place.shape)
    rate = CameraRate(np.array(turn), np.array([0.3, 0.0, -12.0]))
    bias, dt = 1e-3, 1e-4

    def seen(t: float) -> np.ndarray:
        T_now_start = rate.over(t)
        px, disparity = camera.project(T_now_start.apply(place + own * t))
        return np.asarray(T_now_start.inverse().apply(camera.triangulate(px, disparity + bias)))

    apparent = (seen(dt) - seen(-dt)) / (2 * dt) - own
    expected = rate.velocity_by_bias(place, own, camera) * bias
    assert apparent == pytest.approx(expected, rel=2e-3, abs=1e-6)
    assert np.linalg.norm(expected, axis=1).min() > 1e-5


def test_nothing_seems_to_move_for_a_camera_that_stands(camera: StereoCamera) -> None:
    place = np.array([[1.0, 0.0, 5.0]])
    drift = CameraRate.still().velocity_by_bias(place, np.zeros((1, 3)), camera)
    assert drift == pytest.approx(np.zeros((1, 3)))


def test_what_is_behind_the_camera_has_no_disparity(camera: StereoCamera) -> None:
    rate = CameraRate(np.zeros(3), np.array([0.0, 0.0, -1.0]))
    drift = rate.velocity_by_bias(np.array([[1.0, 0.0, -5.0]]), np.zeros((1, 3)), camera)
    assert drift == pytest.approx(np.zeros((1, 3)))


def test_a_rate_is_the_motion_per_second() -> None:
    moved = Pose.from_rotvec([0.01, -0.02, 0.005], [0.1, 0.0, -0.3])
    again = CameraRate.of(moved, 0.1).over(0.1)
    assert again.matrix == pytest.approx(moved.matrix)
