from __future__ import annotations

import numpy as np
import pytest

from observer.geometry import Pose
from observer.methods.monocular.ground import GroundPlane
from observer.methods.monocular.rays import RayPoints
from observer.methods.monocular.scale import (
    correction,
    ground_scale,
    odometry_scale,
    scale_by_ground,
    sigma_after_distance,
)
from observer.mount import CameraMount

MOUNT = CameraMount(0.4, np.radians(5))


def planted(seed: int, enlarged: float, floor_share: float = 0.6) -> RayPoints:
    """Points on the ground and on things standing on it, in a map enlarged by a factor."""
    rng = np.random.default_rng(seed)
    rays = np.column_stack([rng.uniform(-0.5, 0.5, 200), rng.uniform(0.0, 0.28, 200), np.ones(200)])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    inverse = GroundPlane.below(MOUNT).inverse_distance(np.zeros(3), rays)
    above = rng.uniform(size=200) > floor_share
    inverse = np.where(above, inverse * rng.uniform(1.2, 3.0, 200), inverse)
    sigma = 0.02 * inverse
    noisy = inverse + sigma * rng.standard_normal(200)
    return RayPoints.begin(
        np.zeros((200, 2), np.float32), np.zeros(3), rays, noisy / enlarged, (sigma / enlarged) ** 2
    )


@pytest.mark.parametrize("enlarged", [0.2, 1.0, 7.0])
def test_the_floor_gives_the_initial_scale_to_one_percent(enlarged: float) -> None:
    points = planted(1, enlarged)
    slope = points.ray @ MOUNT.down
    low = slope > 0.06
    estimate = scale_by_ground(
        points.inverse[low] / slope[low], np.full(low.sum(), 0.02), MOUNT.height_m, np.inf
    )
    assert estimate is not None
    assert np.exp(estimate[0]) * enlarged == pytest.approx(1, abs=0.01)
    assert 0 < estimate[1] < 0.03


def test_a_drifted_map_is_corrected_by_the_floor() -> None:
    ground = GroundPlane.below(MOUNT)
    estimate = ground_scale(planted(2, 1.06), Pose.identity(), ground, 0.05)
    assert estimate is not None
    assert np.exp(estimate[0]) == pytest.approx(1 / 1.06, abs=0.01)
    factor, after = correction(0.05, *estimate)
    assert factor == pytest.approx(1 / 1.06, abs=0.015)
    assert after < 0.05


def test_no_scale_is_given_without_a_floor() -> None:
    assert scale_by_ground(np.ones(5), np.full(5, 0.02), 0.4, np.inf) is None
    assert scale_by_ground(np.ones(50), np.full(50, 0.9), 0.4, np.inf) is None


def test_odometry_gives_the_scale_once_the_distance_is_long_enough() -> None:
    assert odometry_scale(0.01, 0.05, 0.0, 0.02) is None
    estimate = odometry_scale(0.15, 0.30, 0.0, 0.02)
    assert estimate is not None
    assert np.exp(estimate[0]) == pytest.approx(2)
    assert estimate[1] >= 0.02
    # A turn moves the camera about an axle whose place is uncertain.
    turning = odometry_scale(0.15, 0.30, 0.2, 0.02)
    assert turning is not None
    assert turning[1] > estimate[1]


def test_scale_uncertainty_grows_with_distance_and_shrinks_by_measuring() -> None:
    later = sigma_after_distance(0.01, 1.0)
    assert later > 0.02
    _, measured = correction(later, 0.0, 0.02)
    assert measured < 0.02
