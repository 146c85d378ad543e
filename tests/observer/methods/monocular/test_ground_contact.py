from __future__ import annotations

import numpy as np
import pytest

from observer.camera import StereoCamera
from observer.geometry import Pose
from observer.methods.monocular.ground import GroundPlane, GroundView
from observer.methods.monocular.ground_contact import (
    ground_place,
    lower_edge,
    shared_covariance,
    shared_velocity_covariance,
)
from observer.mount import CameraMount

CAMERA = StereoCamera(512, 256, 443.0, 443.0, 255.5, 127.5, 0.12)
FLOOR = GroundPlane.below(CameraMount(0.4, np.radians(5)))


def view_of(ground: GroundPlane) -> GroundView:
    return GroundView(ground, Pose.identity(), CAMERA)


VIEW = view_of(FLOOR)


def foot_px(right: float, ahead: float) -> np.ndarray:
    place = FLOOR.axes @ [right, ahead] + FLOOR.depth * FLOOR.down
    return CAMERA.project(place)[0]


@pytest.mark.parametrize("ahead", [1.5, 3.0, 5.0])
def test_the_foot_of_a_known_box_is_found_and_placed(ahead: float) -> None:
    u, v = foot_px(0.3, ahead)
    half, tall = 0.2 * 443 / ahead, 0.3 * 443 / ahead
    rng = np.random.default_rng(int(ahead))
    image = rng.normal(150, 3, (256, 512))
    row = round(float(v))
    image[row - int(tall) : row, int(u - half) : int(u + half)] = rng.normal(40, 6)
    box = (u - half, v - tall, u + half, v - 4)
    found = lower_edge(image.clip(0, 255).astype(np.uint8), box, v - 4)
    assert found is not None
    assert found == pytest.approx(v, abs=1.5)
    placed = ground_place((u, v), (1.0, 1.0), VIEW)
    assert placed is not None
    np.testing.assert_allclose(placed[0], (0.3, ahead), atol=1e-6)
    # One row corresponds to r^2 / (f h) metres along the line of sight.
    assert np.sqrt(placed[1][1, 1]) == pytest.approx(ahead**2 / (443 * 0.4), rel=0.15)


def test_no_floor_above_the_horizon_and_no_edge_on_a_plain_wall() -> None:
    assert ground_place((255.0, 20.0), (1.0, 1.0), VIEW) is None
    plain = np.full((256, 512), 90, np.uint8)
    assert lower_edge(plain, (100.0, 100.0, 150.0, 150.0), 150.0) is None


def test_a_wrong_height_or_tilt_shifts_positions_as_the_covariance_states() -> None:
    px = foot_px(0.5, 3.0)
    true = ground_place(tuple(px), (1.0, 1.0), VIEW)
    tilted = GroundPlane.below(CameraMount(0.4, np.radians(5.2)))
    high = GroundPlane.below(CameraMount(0.4 * 1.02, np.radians(5)))
    assert true is not None
    by_tilt = ground_place(tuple(px), (1.0, 1.0), view_of(tilted))
    by_height = ground_place(tuple(px), (1.0, 1.0), view_of(high))
    assert by_tilt is not None
    assert by_height is not None
    for moved, height, tilt in ((by_tilt, 0.0, np.radians(0.2)), (by_height, 0.02, 0.0)):
        cov = shared_covariance(true[0], VIEW, height, tilt)
        gap = np.linalg.norm(moved[0] - true[0])
        assert np.sqrt(np.trace(cov)) == pytest.approx(gap, rel=0.25)


def test_a_velocity_is_as_uncertain_as_the_distance() -> None:
    cov = shared_velocity_covariance(np.array([0.0, 4.0]), np.array([0.5, 0.0]), VIEW, 0.02, 0.0)
    assert np.sqrt(cov[0, 0]) == pytest.approx(0.01)
    assert cov[1, 1] == pytest.approx(0)
