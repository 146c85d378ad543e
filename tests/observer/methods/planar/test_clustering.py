"""Points that belong together, and their common position, box and velocity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.geometry import Pose
from observer.methods.planar.clustering import detect_obstacles, group_points
from observer.methods.planar.results import Detection, PointMotions
from observer.parameters import ClusteringParameters, MotionParameters


def blob(centre: tuple[float, float, float], count: int, seed: int = 0) -> np.ndarray:
    return np.array(centre) + np.random.default_rng(seed).uniform(-0.15, 0.15, (count, 3))


def test_two_groups_and_an_outlier_are_found() -> None:
    points = np.concatenate([blob((1, 0, 4), 10), [[-2.0, 0, 3]], blob((0, 0, 2), 8, 1)])
    labels = group_points(points, np.full(19, 0.01), ClusteringParameters())
    assert labels.tolist() == [1] * 10 + [-1] + [0] * 8  # the nearest first


def test_depth_noise_stretches_the_neighbourhood_along_the_ray_only() -> None:
    parameters = ClusteringParameters(radius_m=0.2, min_points=2)
    along = np.array([[0.0, 0, 4.0], [0.0, 0, 4.5]])
    across = np.array([[0.0, 0, 4.0], [0.5, 0, 4.0]])
    assert group_points(along, np.full(2, 0.01), parameters).tolist() == [-1, -1]
    assert group_points(along, np.full(2, 0.3), parameters).tolist() == [0, 0]
    assert group_points(across, np.full(2, 0.3), parameters).tolist() == [-1, -1]


def test_no_points_give_no_groups() -> None:
    assert group_points(np.empty((0, 3)), np.empty(0), ClusteringParameters()).shape == (0,)
    single = group_points(np.array([[0, 0, 1.0]]), np.zeros(1), ClusteringParameters(min_points=1))
    assert single.tolist() == [0]


@settings(max_examples=30)
@given(seed=st.integers(0, 10_000), count=st.integers(0, 60))
def test_groups_do_not_depend_on_the_order_of_points(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform((-1, -0.5, 1), (1, 0.5, 4), (count, 3))
    sigma = rng.uniform(0, 0.1, count)
    parameters = ClusteringParameters(min_points=2)
    labels = group_points(points, sigma, parameters)
    order = rng.permutation(count)
    np.testing.assert_array_equal(
        group_points(points[order], sigma[order], parameters), labels[order]
    )
    sizes = np.bincount(labels[labels >= 0], minlength=labels.max(initial=-1) + 1)
    assert (sizes >= 2).all()


def motions(
    points: np.ndarray,
    velocity: np.ndarray,
    *,
    sigma: float = 0.1,
    error: tuple[float, float, float] = (0.0, 0.0, 0.0),
    pose_sigma: float = 0.0,
    turn: Pose | None = None,
) -> PointMotions:
    count = len(points)
    return PointMotions(
        points_previous=points,
        points_current=points,
        points_camera=points,
        px_current=points[:, :2] * 100,
        velocity=velocity,
        velocity_cov=np.tile(np.eye(3) * sigma**2, (count, 1, 1)),
        point_cov=np.tile(np.eye(3) * 1e-4, (count, 1, 1)),
        model_error=np.tile(error, (count, 1)),
        model_error_cov=np.tile(np.eye(3) * pose_sigma**2, (count, 1, 1)),
        R_current_previous=(turn or Pose.identity()).rotation,
    )


def detect(measured: PointMotions, **motion: float) -> tuple[Detection, ...]:
    plain = {"min_significance": 0.0, "turn_sigma_radps": 0.0}
    parameters = MotionParameters(**{**plain, **motion})
    return detect_obstacles(measured, 1.5, ClusteringParameters(), parameters)


def test_an_obstacle_has_the_mean_velocity_and_extent_of_its_points() -> None:
    points = np.array([[0, 0, 2], [0.2, 0, 2], [0.2, 0.1, 2.1], [0, 0.1, 2.2]], float)
    velocity = np.array([[0.3, 0, 0], [0.32, 0, 0], [0.28, 0.02, 0], [0.3, -0.02, 0]])
    (found,) = detect(motions(points, velocity))
    np.testing.assert_allclose(found.velocity, (0.3, 0, 0), atol=1e-12)
    np.testing.assert_allclose(found.position, points.mean(axis=0))
    np.testing.assert_allclose(found.size, (0.2, 0.1, 0.2))
    assert found.box_px == (0.0, 0.0, 20.0, 10.0)
    assert found.points == 4
    assert found.speed == pytest.approx(0.3)
    assert found.velocity_time == 1.5


def test_a_point_with_a_different_motion_is_excluded() -> None:
    points = blob((0, 0, 2), 12)
    velocity = np.tile([0.3, 0.0, 0.0], (12, 1))
    velocity[4] = (0.3, 0.0, 5.0)
    (found,) = detect(motions(points, velocity))
    assert found.points == 11
    np.testing.assert_allclose(found.velocity, (0.3, 0, 0), atol=1e-12)


def test_the_velocity_and_its_uncertainty_are_in_the_axes_of_the_newest_frame() -> None:
    turn = Pose.from_rotvec([0.02, 0.3, -0.05], np.zeros(3))
    points, R = blob((0, 0, 2), 12), turn.rotation
    velocity = np.random.default_rng(3).normal((0.1, 0, 0.6), 0.02, (12, 3))
    ahead = np.diag([0.1, 0.1, 0.5]) ** 2
    before = motions(points, velocity, turn=turn)
    before = replace(
        before,
        velocity_cov=np.tile(ahead, (12, 1, 1)),
        model_error=np.tile((0.0, 0.0, 0.2), (12, 1)),
        model_error_cov=np.tile(ahead / 4, (12, 1, 1)),
    )
    now = replace(
        before,
        velocity=turn.rotate(before.velocity),
        velocity_cov=R @ before.velocity_cov @ R.T,
        model_error=turn.rotate(before.model_error),
        model_error_cov=R @ before.model_error_cov @ R.T,
        R_current_previous=np.eye(3),
    )
    (found,), (expected,) = detect(before), detect(now)
    np.testing.assert_allclose(found.velocity, R @ velocity.mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(found.velocity_cov, expected.velocity_cov, atol=1e-12)
    assert found.significance == pytest.approx(expected.significance)


@pytest.mark.parametrize("shared", [0.0, 0.4, 1.0])
def test_averaging_reduces_only_noise_that_points_do_not_share(shared: float) -> None:
    rng = np.random.default_rng(2)
    count, sigma, truth = 16, 0.1, np.array([0.3, 0.1, -0.2])
    points = blob((0, 0, 2), count)
    means, stated = [], []
    for _ in range(300):
        common = rng.normal(0, sigma * np.sqrt(shared), 3)
        own = rng.normal(0, sigma * np.sqrt(1 - shared), (count, 3))
        (found,) = detect(motions(points, truth + common + own), noise_correlation=shared)
        means.append(found.velocity)
        assert found.velocity_cov is not None
        stated.append(np.sqrt(np.diag(found.velocity_cov)))
    np.testing.assert_allclose(np.std(means, axis=0), np.mean(stated, axis=0), rtol=0.15)


def test_motion_that_parallax_explains_is_not_significant() -> None:
    points = blob((0, 0, 2), 10)
    velocity = np.tile([0.3, 0.0, 0.0], (10, 1))
    parallax = motions(points, velocity, sigma=0.02, error=(0.3, 0.0, 0.0))
    other_way = motions(points, velocity, sigma=0.02, error=(0.0, 0.3, 0.0))
    (found,) = detect(parallax)
    assert found.significance < 1.1
    assert detect(parallax, min_significance=3.0) == ()
    (moving,) = detect(other_way, min_significance=3.0)
    assert moving.significance > 10
    assert found.velocity_cov is not None
    assert found.velocity_cov[0, 0] > 0.09


def test_the_uncertainty_is_unknown_without_a_pose() -> None:
    points = blob((0, 0, 2), 10)
    measured = motions(points, np.tile([0.3, 0.0, 0.0], (10, 1)), error=(np.nan,) * 3)
    (found,) = detect(measured, min_significance=3.0)
    assert found.velocity_cov is None
    assert np.isfinite(found.significance)


def test_no_motions_give_no_obstacles() -> None:
    assert detect(motions(np.empty((0, 3)), np.empty((0, 3)))) == ()


def test_the_pose_error_is_shared_by_all_points_and_not_averaged_away() -> None:
    points = blob((0, 0, 2), 100)
    velocity = np.tile([0.3, 0.0, 0.0], (100, 1))
    (certain,) = detect(motions(points, velocity), noise_correlation=0.0)
    (doubtful,) = detect(motions(points, velocity, pose_sigma=0.2), noise_correlation=0.0)
    assert certain.velocity_cov is not None
    assert doubtful.velocity_cov is not None
    np.testing.assert_allclose(np.diag(certain.velocity_cov), 0.01**2)
    np.testing.assert_allclose(np.diag(doubtful.velocity_cov), 0.01**2 + 0.2**2)
    assert doubtful.significance < certain.significance


def test_scatter_beyond_the_noise_makes_the_velocity_less_certain() -> None:
    points = blob((0, 0, 2), 60)
    scatter = np.random.default_rng(0).normal(0, (0.3, 0.01, 0.01), (60, 3))
    velocity = np.array([0.4, 0.0, 0.0]) + scatter
    (found,) = detect(motions(points, velocity, sigma=0.1), noise_correlation=0.0)
    assert found.velocity_cov is not None
    sigma = np.sqrt(np.diag(found.velocity_cov) * found.points)
    np.testing.assert_allclose(sigma, (0.3, 0.1, 0.1), rtol=0.2)


def test_unseen_turning_lowers_the_certainty_but_not_the_significance() -> None:
    points = np.array([[0, 0, 2], [0.2, 0, 2], [0.2, 0.1, 2.15], [0, 0.1, 2.15]], float)
    measured = motions(points, np.tile([0.3, 0.0, 0.0], (4, 1)), sigma=0.02)
    (straight,) = detect(measured)
    (turning,) = detect(measured, turn_sigma_radps=0.5)
    assert straight.velocity_cov is not None
    assert turning.velocity_cov is not None
    added = turning.velocity_cov - straight.velocity_cov
    np.testing.assert_allclose(added, np.diag([1, 0, 1]) * (0.5 * 0.125) ** 2, atol=1e-12)
    assert turning.significance == straight.significance


def test_all_points_are_kept_when_none_moves_like_the_median() -> None:
    # Each is far from the median along one axis, on which the others agree.
    velocity = np.repeat(5.0 * np.eye(3), 3, axis=0)
    (found,) = detect(motions(blob((0, 0, 2), 9), velocity, sigma=1e-3))
    assert found.points == 9
