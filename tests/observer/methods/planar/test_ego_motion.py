"""Ego-motion of planar models, against known maps and a known camera motion."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.camera import StereoCamera
from observer.geometry import Pose, map_pixels
from observer.methods.planar.ego_motion import (
    PlanarEgoMotion,
    decompose_affine,
    estimate_ego_motion,
)
from observer.parameters import EgoMotionParameters
from observer.types import EgoMotion, Matches, Status

CAMERA = StereoCamera(512, 256, 443.0, 443.0, 255.5, 127.5, 0.12)
AFFINE = np.array([[1.01, 0.02, -3.0], [-0.015, 0.99, 2.0], [0, 0, 1]])
HOMOGRAPHY = np.array([[1.01, 0.02, -3.0], [-0.015, 0.99, 2.0], [2e-5, -1e-5, 1]])


def mapped(H: np.ndarray, count: int, outliers: int, noise: float = 0.2, seed: int = 0) -> Matches:
    """Matches that follow H; the first ``outliers`` are on an obstacle."""
    rng = np.random.default_rng(seed)
    previous = rng.uniform((0, 0), (511, 255), (count, 2))
    current = map_pixels(H, previous) + rng.normal(0, noise, (count, 2))
    current[:outliers] += (9.0, 3.0)
    return Matches(previous.astype(np.float32), current.astype(np.float32))


@pytest.mark.parametrize(("model", "H"), [("affine", AFFINE), ("homography", HOMOGRAPHY)])
def test_the_map_is_found_and_obstacle_points_are_outliers(model: str, H: np.ndarray) -> None:
    matches = mapped(H, 200, 60)
    ego = estimate_ego_motion(matches, None, CAMERA, EgoMotionParameters(model=model), 0)
    assert not ego.inliers[:60].any()
    assert ego.inliers[60:].mean() > 0.98
    grid = np.stack(np.meshgrid([20.0, 250.0, 490.0], [20.0, 230.0]), axis=-1).reshape(-1, 2)
    assert np.abs(ego.predict(grid, None) - map_pixels(H, grid)).max() < 0.3
    assert ego.residual_rms_px == pytest.approx(0.2, rel=0.2)


def test_an_unknown_pose_is_degraded_with_a_reason() -> None:
    ego: EgoMotion = estimate_ego_motion(
        mapped(AFFINE, 100, 0), None, CAMERA, EgoMotionParameters(), 0
    )
    assert ego.status is Status.DEGRADED
    assert ego.T_current_previous is None
    assert any("pose is unknown" in reason for reason in ego.reasons)
    assert ego.homography is not None


def prediction_covariance(ego: PlanarEgoMotion, px: np.ndarray) -> np.ndarray:
    """Covariance (2, 2) px^2 of ``predict`` at a pixel (1, 2), from that of the parameters."""
    assert ego.homography is not None
    assert ego.covariance is not None
    step = 1e-7
    changes = step * np.eye(9)[: len(ego.covariance)].reshape(-1, 3, 3)
    here = map_pixels(ego.homography, px)
    J = np.concatenate([map_pixels(ego.homography + c, px) - here for c in changes]).T / step
    return np.asarray(J @ ego.covariance @ J.T)


@pytest.mark.parametrize(
    ("model", "H", "size"), [("affine", AFFINE, 6), ("homography", HOMOGRAPHY, 8)]
)
def test_the_covariance_matches_the_spread_of_the_estimates(
    model: str, H: np.ndarray, size: int
) -> None:
    parameters = EgoMotionParameters(model=model)
    egos = [
        estimate_ego_motion(mapped(H, 80, 0, 0.3, seed), None, CAMERA, parameters, seed)
        for seed in range(60)
    ]
    assert egos[0].covariance is not None
    assert egos[0].covariance.shape == (size, size)
    place = np.array([[400.0, 60.0]])
    scatter = np.cov(np.concatenate([e.predict(place) for e in egos]).T)
    stated = np.mean([prediction_covariance(e, place) for e in egos], axis=0)
    ratio = np.sqrt(np.diag(scatter) / np.diag(stated))
    assert (ratio > 0.7).all()
    assert (ratio < 1.4).all()


@pytest.mark.parametrize("model", ["affine", "homography"])
def test_equal_input_and_seed_give_equal_results(model: str) -> None:
    matches = mapped(AFFINE, 150, 70, 1.0)
    parameters = EgoMotionParameters(model=model, ransac_iterations=10, ransac_threshold_px=1.5)

    def fit(seed: int) -> np.ndarray:
        ego = estimate_ego_motion(matches, None, CAMERA, parameters, seed)
        assert ego.homography is not None
        return ego.homography

    np.testing.assert_array_equal(fit(7), fit(7))
    assert any(not np.array_equal(fit(7), fit(seed)) for seed in range(8, 13))


def rigid_matches(T_current_previous: Pose, seed: int = 0) -> tuple[Matches, np.ndarray]:
    """A wall at 3 m and things in front of it, seen before and after the camera moved."""
    rng = np.random.default_rng(seed)
    px = rng.uniform((0, 0), (511, 255), (300, 2))
    depth = np.where(rng.uniform(size=300) < 0.7, 3.0, rng.uniform(2.0, 2.8, 300))
    disparity = CAMERA.fx * CAMERA.baseline / depth
    after, _ = CAMERA.project(T_current_previous.apply(CAMERA.triangulate(px, disparity)))
    after += rng.normal(0, 0.1, after.shape)
    measured = disparity + rng.normal(0, 0.1, 300)
    return Matches(px.astype(np.float32), after.astype(np.float32)), measured


def test_the_pose_is_found_from_the_inliers() -> None:
    true = Pose.from_rotvec((0.004, -0.01, 0.003), (0.01, 0.002, -0.02))
    matches, disparity = rigid_matches(true)
    ego = estimate_ego_motion(matches, disparity, CAMERA, EgoMotionParameters(), 0)
    assert ego.status is Status.OK
    assert ego.T_current_previous is not None
    error = ego.T_current_previous @ true.inverse()
    assert np.linalg.norm(error.rotvec) < 0.002
    assert np.linalg.norm(error.translation) < 0.006


def test_there_is_no_pose_without_depth() -> None:
    matches, disparity = rigid_matches(Pose.identity())
    unknown = np.full_like(disparity, np.nan)
    ego = estimate_ego_motion(matches, unknown, CAMERA, EgoMotionParameters(), 0)
    assert ego.T_current_previous is None
    assert ego.homography is not None


@pytest.mark.parametrize("model", ["affine", "homography"])
@pytest.mark.parametrize("count", [0, 1, 3, 11])
def test_too_few_matches_are_lost_with_a_reason(model: str, count: int) -> None:
    parameters = EgoMotionParameters(model=model)
    ego = estimate_ego_motion(mapped(AFFINE, count, 0), np.ones(count), CAMERA, parameters, 0)
    assert ego.status is Status.LOST
    assert f"only {count} matches" in ego.reasons[0]
    assert ego.homography is None
    assert ego.covariance is None
    assert ego.inliers.shape == (count,)
    assert np.isnan(ego.predict(np.zeros((2, 2)), None)).all()


def test_random_matches_are_lost() -> None:
    rng = np.random.default_rng(0)
    previous, current = rng.uniform((0, 0), (511, 255), (2, 60, 2)).astype(np.float32)
    ego = estimate_ego_motion(Matches(previous, current), None, CAMERA, EgoMotionParameters(), 0)
    assert ego.status is Status.LOST
    assert "agree on one motion" in ego.reasons[0]


@pytest.mark.parametrize("model", ["affine", "homography"])
def test_an_implausible_motion_is_lost(model: str) -> None:
    mirrored = np.diag([-1.0, 1.0, 1.0])
    mirrored[0, 2] = 511
    parameters = EgoMotionParameters(model=model)
    ego = estimate_ego_motion(mapped(mirrored, 100, 0), None, CAMERA, parameters, 0)
    assert ego.status is Status.LOST
    assert "implausible" in ego.reasons[0]


@pytest.mark.parametrize("model", ["affine", "homography"])
def test_collinear_points_do_not_raise_an_error(model: str) -> None:
    px = np.stack([np.linspace(0, 500, 50), np.full(50, 100.0)], axis=1).astype(np.float32)
    ego = estimate_ego_motion(
        Matches(px, px + 1), np.full(50, 20.0), CAMERA, EgoMotionParameters(model=model), 0
    )
    assert ego.status in Status
    assert ego.homography is None or np.isfinite(ego.homography).all()


def test_few_inliers_are_degraded_with_a_reason() -> None:
    matches = mapped(AFFINE, 45, 0)
    scattered = np.random.default_rng(99).uniform(-90, 90, (28, 2))
    matches.current[:28] += scattered.astype(np.float32)
    ego = estimate_ego_motion(matches, None, CAMERA, EgoMotionParameters(), 0)
    assert ego.status is Status.DEGRADED
    assert any("only 17 matches" in reason for reason in ego.reasons)
    assert any("38 %" in reason for reason in ego.reasons)


@settings(max_examples=50)
@given(
    angle=st.floats(-3.1, 3.1),
    shear=st.floats(-2, 2),
    scale_x=st.floats(0.2, 3),
    scale_y=st.floats(0.2, 3),
    reflected=st.booleans(),
)
def test_the_decomposition_recovers_the_composed_parameters(
    angle: float, shear: float, scale_x: float, scale_y: float, reflected: bool
) -> None:
    scale_y = -scale_y if reflected else scale_y
    rotation = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    matrix = np.column_stack([rotation @ [[scale_x, shear * scale_y], [0, scale_y]], [4.0, -5.0]])
    found = decompose_affine(matrix)
    assert found.translation_px == (4.0, -5.0)
    assert found.rotation_rad == pytest.approx(angle, abs=1e-9)
    assert found.shear == pytest.approx(shear, abs=1e-9)
    assert found.scale == pytest.approx((scale_x, scale_y))


@pytest.mark.parametrize(
    ("row", "expected"),
    [
        # t11 t12 / t21 t22 as in the paper's table I.
        ([[1, 0], [0, 1]], (0.0, 0.0, (1, 1))),
        ([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]], (0.3, 0.0, (1, 1))),
        ([[1, 0.2], [0, 1]], (0.0, 0.2, (1, 1))),
        ([[1.2, 0], [0, 0.9]], (0.0, 0.0, (1.2, 0.9))),
        ([[1, 0], [0, -1]], (0.0, 0.0, (1, -1))),
    ],
)
def test_the_decomposition_follows_table_one(
    row: list[list[float]], expected: tuple[float, float, tuple[float, float]]
) -> None:
    found = decompose_affine(np.column_stack([row, [0.0, 0.0]]))
    assert found.rotation_rad == pytest.approx(expected[0])
    assert found.shear == pytest.approx(expected[1])
    assert found.scale == pytest.approx(expected[2])


def test_the_pose_covariance_matches_its_scatter() -> None:
    true = Pose.from_rotvec((0.004, -0.01, 0.003), (0.01, 0.002, -0.02))
    poses, stated = [], []
    for seed in range(40):
        matches, disparity = rigid_matches(true, seed)
        ego = estimate_ego_motion(matches, disparity, CAMERA, EgoMotionParameters(), seed)
        assert ego.T_current_previous is not None
        assert ego.pose_covariance is not None
        error = ego.T_current_previous @ true.inverse()
        poses.append(np.concatenate([error.rotvec, error.translation]))
        stated.append(np.sqrt(np.diag(ego.pose_covariance)))
    ratio = np.std(poses, axis=0) / np.mean(stated, axis=0)
    # PnP does not model the noise of depth; only its effect on the residuals counts.
    assert (ratio > 0.5).all()
    assert (ratio < 2.0).all()
