"""The kernel for the camera's pose against the same formulas by numpy."""

from __future__ import annotations

import numpy as np
import pytest

from observer.camera import StereoCamera
from observer.geometry import Pose
from observer.kernels.pose_fit import fit_pose
from observer.parameters import EgoMotionParameters

from .oracles import pose_fit as oracle
from .oracles.pose_residuals import SeenPoints

CAMERA = StereoCamera(512, 256, 300.0, 301.0, 255.0, 127.0, 0.12)
EXPECTED = Pose.from_rotvec([0.01, -0.03, 0.005], [0.02, 0.01, -0.1])


def seen_points(seed: int, *, moving: float, deep: float, count: int = 150) -> SeenPoints:
    """Points in front of a moving camera, some on a mover, some without disparity."""
    rng = np.random.default_rng(seed)
    place = rng.uniform([-3, -1, 1], [3, 1, 8], (count, 3))
    # One is behind the camera, where nothing can be seen.
    place[0, 2] = -1.0
    truth = Pose.from_rotvec(rng.normal(0, 0.02, 3), rng.normal(0, 0.05, 3)) @ EXPECTED
    moved = place + np.where(rng.random(count) < moving, 0.3, 0.0)[:, None]
    px, disparity = CAMERA.project(truth.apply(moved))
    px = np.where(np.isfinite(px), px, 100.0) + rng.normal(0, 0.2, (count, 2))
    disparity = np.where(rng.random(count) < deep, disparity + rng.normal(0, 0.2, count), np.nan)
    spread = rng.normal(0, 0.01, (count, 3, 3))
    covariance = spread @ spread.transpose(0, 2, 1)
    return SeenPoints.of(place, covariance, px, disparity, rng.uniform(0.1, 0.5, (count, 3)))


def by_kernel(
    points: SeenPoints, share: np.ndarray, parameters: EgoMotionParameters, seed: int
) -> tuple[np.ndarray, ...]:
    return fit_pose(
        np.ascontiguousarray(points.place.T),
        np.ascontiguousarray(points.covariance.T).reshape(-1, 3, 3),
        np.column_stack([*points.seen[:2], np.where(points.known, points.seen[2], np.nan)]),
        np.ascontiguousarray(points.variance.T),
        share,
        EXPECTED.rotation,
        EXPECTED.translation,
        (CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, CAMERA.baseline),
        parameters.ransac_threshold_px,
        parameters.min_inliers,
        parameters.ransac_iterations,
        np.random.default_rng(seed).random((parameters.ransac_iterations, 3)),
    )


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize(
    ("moving", "deep"), [(0.0, 1.0), (0.3, 0.9), (0.6, 0.5), (0.0, 0.0), (0.3, 0.01)]
)
def test_the_fitted_pose_matches_numpy(seed: int, moving: float, deep: float) -> None:
    points = seen_points(seed, moving=moving, deep=deep)
    share = np.random.default_rng(seed).uniform(0.2, 1.0, len(points.known))
    parameters = EgoMotionParameters(ransac_iterations=96)
    pose, fit, information = oracle.fit_pose(points, share, EXPECTED, CAMERA, parameters, seed)
    R, t, length, inliers, found = by_kernel(points, share, parameters, seed)
    np.testing.assert_allclose(R, pose.rotation, atol=1e-8)
    np.testing.assert_allclose(t, pose.translation, atol=1e-8)
    np.testing.assert_array_equal(inliers, fit.inliers)
    np.testing.assert_allclose(length, fit.mahalanobis, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found, information, rtol=1e-6, atol=1e-3)


def test_the_expected_pose_is_returned_when_all_points_are_behind_the_camera() -> None:
    points = seen_points(0, moving=0.0, deep=1.0, count=20)
    points.place[2] = -5.0
    R, t, length, inliers, _ = by_kernel(points, np.ones(20), EgoMotionParameters(), 0)
    np.testing.assert_array_equal(R, EXPECTED.rotation)
    np.testing.assert_array_equal(t, EXPECTED.translation)
    assert np.isinf(length).all()
    assert not inliers.any()
