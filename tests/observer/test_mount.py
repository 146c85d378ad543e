from __future__ import annotations

import numpy as np
import pytest

from observer.mount import CameraMount
from observer.one_camera.floor import Floor
from observer.one_camera.odometry_way import driven_step
from observer.types import Odometry


def test_down_is_where_the_floor_is() -> None:
    np.testing.assert_allclose(CameraMount(0.4, 0.0).down, (0, 1, 0))
    np.testing.assert_allclose(CameraMount(0.4, np.radians(30)).down, (0, np.sqrt(0.75), 0.5))
    mount = CameraMount(0.4, 0.1)
    np.testing.assert_allclose(mount.R_base_camera @ mount.down, (0, 0, -1), atol=1e-12)
    assert Floor.below(mount).height_of(np.zeros(3)) == pytest.approx(0.4)


def test_driving_ahead_moves_a_tilted_camera_along_the_floor() -> None:
    mount = CameraMount(0.4, 0.1)
    step, way, turn = driven_step(Odometry(1, 2, 0), Odometry(1.5, 2, 0), mount)
    moved = step.inverse().translation
    np.testing.assert_allclose(moved, 0.5 * np.array([0, -np.sin(0.1), np.cos(0.1)]), atol=1e-12)
    assert (way, turn) == (pytest.approx(0.5), 0)


def test_turning_on_the_spot_swings_a_camera_off_the_axle() -> None:
    mount = CameraMount(0.4, 0.0, forward_m=0.1, left_m=0.0)
    step, _, _ = driven_step(Odometry(0, 0, 0), Odometry(0, 0, np.pi / 2), mount)
    # To the left is -x of the camera, and it came from where it now sees to its right.
    np.testing.assert_allclose(step.inverse().translation, (-0.1, 0, -0.1), atol=1e-12)
    assert mount.lever_sigma_m < CameraMount(0.4, 0.0).lever_sigma_m


@pytest.mark.parametrize(("height", "tilt"), [(0.0, 0.1), (-1, 0.1), (np.nan, 0), (0.4, 1.6)])
def test_an_impossible_mount_is_refused(height: float, tilt: float) -> None:
    with pytest.raises(ValueError, match="camera"):
        CameraMount(height, tilt)
