"""The stated covariance of the camera's motion against its errors."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from observer.geometry import Float64Array
from observer.methods.rigid.ego_motion import StaticScene
from observer.parameters import EgoMotionParameters
from observer.vision.rigid_ego_motion import RigidEgoMotion

from ...builders import LAB
from .static_scenes import AFTER, P, both, error_of, estimated, obstacle, seen


def residual_lengths(ego: RigidEgoMotion, scene: StaticScene) -> Float64Array:
    """(N,) Mahalanobis lengths of the residuals in u, v and disparity."""

    def pixels(place: Float64Array) -> Float64Array:
        return np.column_stack(LAB.project(place))

    place, R = ego.T_camera_world.apply(scene.position), ego.T_camera_world.rotation
    residual = np.column_stack([scene.px, scene.disparity]) - pixels(place)
    steps = 1e-6 * np.eye(3)
    J = np.stack([(pixels(place + step) - pixels(place)) / 1e-6 for step in steps], axis=2)
    covariance = J @ (R @ scene.covariance @ R.T) @ J.transpose(0, 2, 1)
    covariance += scene.sigma[:, :, None] ** 2 * np.eye(3)
    return np.sqrt(np.einsum("ni,nij,nj->n", residual, np.linalg.inv(covariance), residual))


def nees(draws: int, count: int, parameters: EgoMotionParameters) -> Float64Array:
    """(draws,) squared Mahalanobis lengths of the pose's error under the stated covariance."""
    lengths = []
    for seed in range(draws):
        ego = estimated(
            seen(np.random.default_rng(1000 + seed), count), expected=AFTER,
            parameters=parameters, seed=seed,
        )  # fmt: skip
        error = error_of(ego)
        assert ego.pose_covariance is not None
        lengths.append(error @ np.linalg.solve(ego.pose_covariance, error))
    return np.array(lengths)


DRAWS = 200
# 99.9 % bounds of the mean over the draws, each with six degrees of freedom.
NEES_BOUNDS = np.asarray(chi2.ppf([0.0005, 0.9995], 6 * DRAWS)) / DRAWS


@pytest.mark.parametrize("count", [40, 120])
def test_the_stated_covariance_matches_the_errors(count: int) -> None:
    independent = P.model_copy(update={"noise_correlation": 0.0})
    mean = nees(DRAWS, count, independent).mean()
    # Outlying points count less and the worst not at all, which costs a little precision.
    assert NEES_BOUNDS[0] < mean < 1.1 * NEES_BOUNDS[1]


def test_shared_errors_of_points_increase_the_covariance() -> None:
    few = P.model_copy(update={"noise_correlation": 0.0})
    scene = seen(np.random.default_rng(0), 100)
    alone, shared = estimated(scene, parameters=few), estimated(scene)
    assert alone.pose_covariance is not None
    assert shared.pose_covariance is not None
    factor = 1 + P.noise_correlation * shared.inliers.sum()
    np.testing.assert_allclose(shared.pose_covariance, factor * alone.pose_covariance, rtol=1e-6)


def test_far_points_give_rotation_but_not_translation() -> None:
    rng = np.random.default_rng(7)
    near = estimated(seen(rng, 200, depths=(1.0, 8.0)))
    far = estimated(seen(rng, 200, depths=(60.0, 200.0)))
    assert near.pose_covariance is not None
    assert far.pose_covariance is not None
    near_std, far_std = (np.sqrt(np.diag(e.pose_covariance)) for e in (near, far))
    assert (far_std[:3] < 2e-3).all()
    assert (far_std[:3] < 2 * near_std[:3]).all()
    assert (far_std[3:] > 10 * near_std[3:]).all()
    assert (np.abs(error_of(far)) < 4 * far_std).all()


@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_excess_noise_is_detected_and_increases_the_uncertainty(factor: float) -> None:
    scales, stds = [], []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        ego = estimated(seen(rng, 200, noise=factor, place_noise=factor), seed=seed)
        assert ego.pose_covariance is not None
        scales.append(ego.noise_scale)
        stds.append(np.sqrt(np.trace(ego.pose_covariance)))
    assert np.mean(scales) == pytest.approx(factor, rel=0.1)
    scene = seen(np.random.default_rng(0), 200)
    quiet = estimated(scene)
    rms = np.sqrt(np.mean(residual_lengths(quiet, scene)[quiet.inliers] ** 2))
    assert rms == pytest.approx(np.sqrt(3), rel=0.1)
    assert quiet.pose_covariance is not None
    stated = np.mean(stds) / np.sqrt(np.trace(quiet.pose_covariance))
    # The worst are rejected as outliers, so the rest seems better than it is.
    assert 0.65 * factor < stated < 1.2 * factor


def test_obstacles_do_not_count_as_noise() -> None:
    rng = np.random.default_rng(0)
    ego = estimated(both(obstacle(rng, 50, (0.1, 0.0, 0.0)), seen(rng, 150)))
    assert ego.noise_scale < 1.4
