"""How constant calibration errors turn the camera's motion into apparent motion of points."""

import numpy as np
import pytest

from observer.camera import StereoCamera
from observer.geometry import Pose
from observer.vision.camera_rate import CameraRate


@pytest.fixture
def camera() -> StereoCamera:
    return StereoCamera(
        width=1242, height=375, fx=721.0, fy=721.0, cx=610.0, cy=173.0, baseline=0.54
    )


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (0.05, -0.4, 0.1)])
@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.0), (0.5, 0.1, -9.0)])
def test_disparity_error_moves_points_as_predicted(
    camera: StereoCamera, turn: tuple[float, ...], velocity: tuple[float, ...]
) -> None:
    """Against finite differences: triangulation with a small constant disparity error."""
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


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (0.05, -0.4, 0.1)])
@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.0), (0.5, 0.1, -9.0)])
def test_stretched_image_moves_points_as_predicted(
    camera: StereoCamera, turn: tuple[float, ...], velocity: tuple[float, ...]
) -> None:
    """Against finite differences: image motion at a corner is too fast by a fixed share."""
    corner = camera.triangulate(np.array([[1242.0, 375.0]]), np.array([10.0]))
    own = np.array([velocity])
    rate = CameraRate(np.array(turn), np.array([0.3, 0.0, -12.0]))
    stretch, dt = 0.03, 1e-4
    start, _ = camera.project(corner)

    def seen(t: float) -> np.ndarray:
        T_now_start = rate.over(t)
        px, disparity = camera.project(T_now_start.apply(corner + own * t))
        px = start + (px - start) * (1 + stretch)
        return np.asarray(T_now_start.inverse().apply(camera.triangulate(px, disparity)))

    apparent = (seen(dt) - seen(-dt)) / (2 * dt) - own
    expected = rate.lasting_errors(corner, own, camera, 0, stretch)[:, 1]
    assert apparent == pytest.approx(expected, rel=0.02, abs=1e-6)
    assert np.linalg.norm(expected) > 0.1


def test_distortion_grows_from_the_centre_to_the_edges(
    camera: StereoCamera,
) -> None:
    rate = CameraRate(np.zeros(3), np.array([-1.0, 0.0, 0.0]))
    u = np.array([camera.cx, 305.0, 0.0])
    px = np.stack([u, np.full(3, camera.cy)], axis=1)
    place = camera.triangulate(px, np.full(3, 20.0))
    seems = -rate.lasting_errors(place, np.zeros_like(place), camera, 0, 1)[:, 1, 0]
    assert seems[0] == pytest.approx(0.0)
    # Half the radius gives a sixteenth; the corners lie a little farther out than the sides.
    assert seems[1] == pytest.approx(seems[2] / 16, rel=0.01)
    assert 0.5 < seems[2] < 1.0


def test_stationary_camera_sees_no_apparent_motion(camera: StereoCamera) -> None:
    place = np.array([[1.0, 0.0, 5.0]])
    still = CameraRate.still()
    errors = still.lasting_errors(place, np.zeros((1, 3)), camera, 1, 1)
    assert errors == pytest.approx(np.zeros((1, 2, 3)))


def test_points_behind_the_camera_have_no_apparent_motion(camera: StereoCamera) -> None:
    rate = CameraRate(np.zeros(3), np.array([0.0, 0.0, -1.0]))
    behind = np.array([[1.0, 0.0, -5.0]])
    errors = rate.lasting_errors(behind, np.zeros((1, 3)), camera, 1, 1)
    assert errors == pytest.approx(np.zeros((1, 2, 3)))


def test_static_flow_is_that_of_the_projections(camera: StereoCamera) -> None:
    rate = CameraRate(np.array([0.1, -0.3, 0.2]), np.array([0.2, -0.1, -0.6]))
    place = np.array([[0.5, -0.3, 2.0], [-1.0, 0.4, 4.0], [0.1, 0.0, 8.0]])
    px, disparity = camera.project(place)
    step_s = 1e-4
    later, _ = camera.project(rate.over(step_s).apply(place))
    earlier, _ = camera.project(rate.over(-step_s).apply(place))
    np.testing.assert_allclose(
        rate.static_flow(px, disparity, camera), (later - earlier) / (2 * step_s), rtol=1e-5
    )


def test_rate_is_the_motion_per_second() -> None:
    moved = Pose.from_rotvec([0.01, -0.02, 0.005], [0.1, 0.0, -0.3])
    again = CameraRate.of(moved, 0.1).over(0.1)
    assert again.matrix == pytest.approx(moved.matrix)
