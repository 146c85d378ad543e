from __future__ import annotations

import numpy as np
import pytest

from observer.camera import StereoCamera
from observer.geometry import Pose
from observer.methods.monocular.two_views import turned_between, two_views

CAMERA = StereoCamera(512, 256, 443.0, 443.0, 255.5, 127.5, 0.12)


def views(T: Pose, seed: int = 0, moving: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lines of sight to points in a room before and after ``T_second_first``, and distances."""
    rng = np.random.default_rng(seed)
    p = np.column_stack([
        rng.uniform(-2, 2, 150), rng.uniform(-1, 0.4, 150), rng.uniform(2, 7, 150)
    ])  # fmt: skip
    later = T.apply(p)
    later[:moving] += (0.3, 0.0, 0.0)
    noise = rng.normal(0, 0.1 / 443, (150, 2))
    first, second = p / p[:, 2:], later / later[:, 2:]
    second[:, :2] += noise
    distance = np.linalg.norm(p, axis=1)
    return unit(first), unit(second), distance


def unit(vectors: np.ndarray) -> np.ndarray:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def test_two_views_give_motion_and_depths_up_to_scale() -> None:
    T = Pose.from_rotvec([0.01, 0.05, 0.0], [-0.06, 0.0, -0.25])
    first, second, distance = views(T, moving=20)
    estimate = two_views(first, second, 0.1 / 443, CAMERA)
    assert estimate is not None
    distance_m = float(np.linalg.norm(T.translation))
    direction = float(estimate.T_second_first.translation @ T.translation) / distance_m
    assert np.degrees(np.arccos(min(direction, 1.0))) < 3
    assert not estimate.inliers[:20].all()
    sharp = estimate.inliers & (estimate.sigma * distance / distance_m < 0.05)
    sharp[:20] = False
    assert sharp.sum() > 30
    ratio = estimate.inverse[sharp] / distance_m * distance[sharp]
    assert abs(np.median(ratio) - 1) < 0.05


def test_turning_leaves_no_parallax() -> None:
    T = Pose.from_rotvec([0.02, 0.3, -0.01], np.zeros(3))
    first, second, _ = views(T)
    R, parallax = turned_between(first, second)
    np.testing.assert_allclose(R, T.rotation, atol=1e-3)
    assert np.degrees(np.median(parallax)) < 0.05


def test_travel_leaves_parallax_that_no_rotation_explains() -> None:
    first, second, _ = views(Pose.from_rotvec([0.0, 0.1, 0.0], [0.0, 0.0, -0.4]))
    _, parallax = turned_between(first, second)
    assert np.degrees(np.median(parallax)) > 0.5


def test_too_few_points_give_no_result() -> None:
    first, second, _ = views(Pose.from_rotvec([0, 0, 0], [0.3, 0, 0]))
    assert two_views(first[:10], second[:10], 0.1 / 443, CAMERA) is None


@pytest.mark.parametrize("seed", range(3))
def test_points_beyond_many_baselines_count_for_the_motion(seed: int) -> None:
    """The camera moves 12 cm sideways; most points are farther than 50 times that."""
    rng = np.random.default_rng(seed)
    px = rng.uniform((8, 8), (CAMERA.width - 9, CAMERA.height - 9), (200, 2))
    depth = rng.uniform(1.5, 15, 200)
    p = CAMERA.triangulate(px, CAMERA.fx * CAMERA.baseline / depth)
    first, second = unit(p), p - (0.12, 0.0, 0.0)
    second = second / second[:, 2:]
    second[:, :2] += rng.normal(0, 0.1 / 443, (200, 2))
    estimate = two_views(first, unit(second), 0.1 / 443, CAMERA)
    assert estimate is not None
    assert estimate.inliers.mean() > 0.9
    assert estimate.T_second_first.translation[0] < -0.98
