from __future__ import annotations

import math

import numpy as np
import pytest

from observer.methods.monocular.ground import GroundPlane
from observer.mount import CameraMount
from observer.types import Odometry
from observer.vision.wheel_odometry import agrees, driven_step

AHEAD = np.array([0.0, 0.0, 1.0])
RIGHT = np.array([1.0, 0.0, 0.0])


def test_down_points_to_the_floor() -> None:
    np.testing.assert_allclose(CameraMount(0.4, 0.0).down, (0, 1, 0))
    np.testing.assert_allclose(CameraMount(0.4, np.radians(30)).down, (0, np.sqrt(0.75), 0.5))
    mount = CameraMount(0.4, 0.1)
    np.testing.assert_allclose(mount.R_base_camera @ mount.down, (0, 0, -1), atol=1e-12)
    assert GroundPlane.below(mount).height_of(np.zeros(3)) == pytest.approx(0.4)


@pytest.mark.parametrize("tilt", [-0.4, 0.0, 0.3])
@pytest.mark.parametrize("roll", [-0.2, 0.0, 0.05])
@pytest.mark.parametrize("pan", [-2.0, 0.0, 0.1])
def test_down_gives_tilt_and_roll_for_any_pan(tilt: float, roll: float, pan: float) -> None:
    mount = CameraMount(0.4, tilt, roll_rad=roll, pan_rad=pan)
    np.testing.assert_allclose(mount.R_base_camera @ mount.down, (0, 0, -1), atol=1e-12)
    np.testing.assert_allclose(CameraMount.angles_of(mount.down), (tilt, roll), atol=1e-12)


def test_positive_pan_looks_left_and_positive_roll_lowers_the_right_side() -> None:
    panned = CameraMount(0.4, 0.0, pan_rad=np.radians(30)).R_base_camera
    np.testing.assert_allclose(panned @ AHEAD, (np.sqrt(0.75), 0.5, 0), atol=1e-12)
    rolled = CameraMount(0.4, 0.0, roll_rad=np.radians(10)).R_base_camera
    np.testing.assert_allclose(rolled @ AHEAD, (1, 0, 0), atol=1e-12)
    assert (rolled @ RIGHT)[2] == pytest.approx(-np.sin(np.radians(10)))


def test_a_tilted_camera_rolls_about_its_optical_axis() -> None:
    straight = CameraMount(0.4, 0.3)
    rolled = CameraMount(0.4, 0.3, roll_rad=0.2)
    np.testing.assert_allclose(rolled.R_base_camera @ AHEAD, straight.R_base_camera @ AHEAD)


def test_levelling_puts_the_floor_at_zero_and_drops_pan_and_offset() -> None:
    mount = CameraMount(0.4, 0.2, 0.3, 0.1, roll_rad=0.05, pan_rad=1.0)
    below = 0.4 * mount.down
    np.testing.assert_allclose(mount.T_level_camera.apply(below), (0, 0, 0), atol=1e-12)
    ahead = mount.T_level_camera.rotate(AHEAD)
    assert ahead[1] == pytest.approx(0, abs=1e-12)
    assert ahead[0] > 0


def test_the_level_frame_is_the_base_frame_without_pan_and_offset() -> None:
    mount = CameraMount(0.4, 0.2, roll_rad=-0.03)
    np.testing.assert_array_equal(mount.T_level_camera.matrix, mount.T_base_camera.matrix)


def test_driving_ahead_moves_a_tilted_camera_along_the_floor() -> None:
    mount = CameraMount(0.4, 0.1)
    step, distance, turn = driven_step(Odometry(1, 2, 0), Odometry(1.5, 2, 0), mount)
    moved = step.inverse().translation
    np.testing.assert_allclose(moved, 0.5 * np.array([0, -np.sin(0.1), np.cos(0.1)]), atol=1e-12)
    assert (distance, turn) == (pytest.approx(0.5), 0)


def test_a_camera_panned_left_sees_forward_motion_to_its_right() -> None:
    mount = CameraMount(0.4, 0.0, pan_rad=np.radians(20))
    step, _, _ = driven_step(Odometry(0, 0, 0), Odometry(1, 0, 0), mount)
    moved = step.inverse().translation
    np.testing.assert_allclose(moved, (np.sin(np.radians(20)), 0, np.cos(np.radians(20))))


def test_turning_on_the_spot_moves_an_off_axle_camera() -> None:
    mount = CameraMount(0.4, 0.0, forward_m=0.1, left_m=0.0)
    step, _, _ = driven_step(Odometry(0, 0, 0), Odometry(0, 0, np.pi / 2), mount)
    # The camera moves 0.1 m to its old left (-x) and 0.1 m back (-z).
    np.testing.assert_allclose(step.inverse().translation, (-0.1, 0, -0.1), atol=1e-12)
    assert mount.lever_sigma_m < CameraMount(0.4, 0.0).lever_sigma_m


@pytest.mark.parametrize(("height", "tilt"), [(0.0, 0.1), (-1, 0.1), (np.nan, 0), (0.4, 1.6)])
def test_an_impossible_mount_is_refused(height: float, tilt: float) -> None:
    with pytest.raises(ValueError, match="camera"):
        CameraMount(height, tilt)


@pytest.mark.parametrize("angles", [{"roll_rad": 1.6}, {"pan_rad": 3.2}, {"pan_rad": np.nan}])
def test_an_upside_down_camera_or_excessive_pan_is_refused(angles: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="camera"):
        CameraMount(0.4, 0.1, **angles)


@pytest.mark.parametrize(
    ("ahead_m", "aside_m", "yaw", "right"),
    [
        (0.04, 0.0, 0.0, True),
        (0.045, 0.0, 0.01, True),
        # As if estimated from a person crossing at 0.3 m/s, or turning along with a passer-by.
        (0.04, 0.03, 0.0, False),
        (0.04, 0.0, 0.03, False),
        (0.0, 0.0, 0.0, False),
    ],
)
def test_odometry_confirms_only_a_similar_motion(
    ahead_m: float, aside_m: float, yaw: float, right: bool
) -> None:
    mount = CameraMount(0.4, 0.1, 0.1, 0.06)
    seen, _, _ = driven_step(Odometry(0, 0, 0), Odometry(ahead_m, aside_m, yaw), mount)
    before, now = (
        Odometry(3, 1, 0.5),
        Odometry(3 + 0.04 * math.cos(0.5), 1 + 0.04 * math.sin(0.5), 0.5),
    )
    assert agrees(seen, before, now, mount, 0.1) == right
    assert not agrees(seen, None, now, mount, 0.1)
    assert not agrees(seen, before, None, mount, 0.1)
