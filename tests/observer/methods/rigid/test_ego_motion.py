"""The camera's motion in space, from points and sightings generated from it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.geometry import Pose
from observer.methods.rigid.ego_motion import estimate_rigid_motion
from observer.parameters import KltTrackingParameters
from observer.types import EgoMotion, Status
from observer.vision.keypoints import density_weights
from observer.vision.rigid_ego_motion import RigidEgoMotion

from ...builders import LAB, ROAD
from .static_scenes import (
    AFTER,
    BEFORE,
    STEP,
    P,
    both,
    but,
    error_of,
    estimated,
    exactly_seen,
    obstacle,
    seen,
)

quick = settings(max_examples=30)


def assert_right(ego: RigidEgoMotion, rotation: float, translation: float) -> None:
    error = error_of(ego)
    assert np.abs(error[:3]).max() < rotation
    assert np.abs(error[3:]).max() < translation


small = st.floats(-0.06, 0.06)

turns = st.tuples(small, small, small)

shifts = st.tuples(*[st.floats(-0.15, 0.15)] * 3)


# --- what is found -------------------------------------------------------------------------


@quick
@given(turns, shifts, st.integers(0, 1000))
def test_the_motion_is_exact_without_noise(
    turn: tuple[float, float, float], shift: tuple[float, float, float], seed: int
) -> None:
    truth = Pose.from_rotvec(turn, shift) @ BEFORE
    ego = estimated(exactly_seen(np.random.default_rng(seed), pose=truth), seed=seed)
    assert ego.status is Status.OK
    assert ego.inliers.all()
    np.testing.assert_allclose(error_of(ego, truth), 0, atol=1e-7)
    assert ego.T_current_previous is not None
    np.testing.assert_allclose((ego.T_current_previous @ BEFORE).matrix, truth.matrix, atol=1e-7)


def test_a_camera_at_rest_is_estimated_at_rest() -> None:
    ego = estimated(exactly_seen(np.random.default_rng(0), pose=BEFORE))
    assert ego.T_current_previous is not None
    np.testing.assert_allclose(ego.T_current_previous.matrix, np.eye(4), atol=1e-9)


def test_the_motion_is_found_on_the_road() -> None:
    rng = np.random.default_rng(0)
    driven = Pose.from_rotvec((0.001, 0.01, 0.0), (0.02, 0.0, -1.4))
    truth = driven @ BEFORE
    scene = seen(rng, 400, camera=ROAD, depths=(6.0, 80.0), pose=truth)
    ego = estimated(scene, camera=ROAD, expected=driven @ BEFORE)
    assert ego.status is Status.OK
    error = error_of(ego, truth)
    assert np.linalg.norm(error[:3]) < 5e-4
    assert np.linalg.norm(error[3:]) < 0.02


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("moved", [(0.05, 0.0, 0.0), (0.0, 0.0, -0.15), (0.03, 0.01, 0.08)])
def test_two_fifths_of_the_points_may_move_with_an_obstacle(
    moved: tuple[float, float, float], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    ego = estimated(both(obstacle(rng, 80, moved), seen(rng, 120)), seed=seed)
    assert_right(ego, 6e-4, 2.5e-3)
    assert ego.inliers[:80].mean() < 0.1
    assert ego.inliers[80:].mean() > 0.95


@pytest.mark.parametrize("seed", range(5))
def test_a_well_textured_obstacle_cannot_outvote_the_background(seed: int) -> None:
    """Two thirds of the points are on it, but they cover few squares of the image."""
    rng = np.random.default_rng(seed)
    crowd = both(obstacle(rng, 160, (0.05, 0.0, 0.02)), seen(rng, 80))
    weight = density_weights(crowd.px.astype(np.float32), KltTrackingParameters(spacing_px=32))
    ego = estimated(but(crowd, weight=weight), seed=seed)
    assert_right(ego, 1e-3, 4e-3)
    assert ego.inliers[:160].mean() < 0.1
    outvoted = estimated(crowd, seed=seed)
    assert outvoted.inliers[:160].mean() > 0.9
    assert np.linalg.norm(error_of(outvoted)[3:]) > 0.02


@pytest.mark.parametrize("seed", range(4))
def test_wrongly_tracked_points_are_excluded(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scene = seen(rng, 200)
    wrong = rng.permutation(200)[:80]
    scene.px[wrong] += rng.uniform(4, 40, (80, 2)) * rng.choice([-1, 1], (80, 2))
    ego = estimated(scene, seed=seed)
    assert_right(ego, 6e-4, 2.5e-3)
    assert not ego.inliers[wrong].any()
    assert ego.inliers.sum() > 110


def test_a_wrong_expected_pose_does_no_harm() -> None:
    rng = np.random.default_rng(3)
    scene = seen(rng)
    for off in (Pose.identity(), Pose.from_rotvec((0.0, 0.1, 0.05), (0.2, 0.0, -0.3))):
        assert_right(estimated(scene, expected=off @ AFTER), 6e-4, 2.5e-3)


# --- what is unknown -----------------------------------------------------------------------


def test_points_without_disparity_are_used_as_inliers() -> None:
    rng = np.random.default_rng(4)
    scene = seen(rng)
    scene.disparity[rng.permutation(200)[:120]] = np.nan
    ego = estimated(scene)
    assert ego.status is Status.OK
    assert ego.inliers.mean() > 0.95
    assert_right(ego, 6e-4, 2.5e-3)


def test_positions_alone_give_the_pose_without_any_disparity() -> None:
    scene = seen(np.random.default_rng(4))
    scene.disparity[:] = np.nan
    ego = estimated(scene, expected=AFTER)
    assert_right(ego, 6e-4, 2.5e-3)
    known = estimated(seen(np.random.default_rng(4)))
    assert ego.pose_covariance is not None
    assert known.pose_covariance is not None
    assert np.trace(ego.pose_covariance) > np.trace(known.pose_covariance)


def test_points_with_unknown_positions_are_ignored() -> None:
    rng = np.random.default_rng(5)
    scene = both(seen(rng, 60), seen(rng, 150))
    scene.covariance[:60] = np.eye(3) * 1e12
    scene.px[:60] += rng.normal(0, 20, (60, 2))
    ego = estimated(scene)
    assert_right(ego, 7e-4, 3e-3)


def test_points_behind_the_camera_are_not_inliers() -> None:
    rng = np.random.default_rng(6)
    behind = seen(rng, 60)
    behind.position[:] = AFTER.inverse().apply(AFTER.apply(behind.position) * [1, 1, -1])
    ego = estimated(both(behind, seen(rng, 140)))
    assert not ego.inliers[:60].any()
    assert_right(ego, 6e-4, 2.5e-3)


# --- status --------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [0, 1, 2, 3, P.min_inliers - 1])
def test_too_few_points_are_lost_with_a_reason(count: int) -> None:
    ego = estimated(seen(np.random.default_rng(0), count))
    assert ego.status is Status.LOST
    assert any(f"only {count} static points" in reason for reason in ego.reasons)
    assert ego.T_camera_world is None
    assert ego.T_current_previous is None
    assert ego.covariance is None
    assert ego.inliers.shape == (count,)
    assert not ego.inliers.any()


def test_points_without_agreement_are_lost_with_a_reason() -> None:
    rng = np.random.default_rng(1)
    scene = seen(rng, 60)
    scene.px[:] = rng.uniform((0, 0), (511, 255), (60, 2))
    ego = estimated(scene)
    assert ego.status is Status.LOST
    assert "agree on one motion" in ego.reasons[0]
    assert ego.T_current_previous is None


def test_few_points_are_enough_but_degraded() -> None:
    count = P.min_inliers + 4
    ego = estimated(seen(np.random.default_rng(2), count))
    assert ego.status is Status.DEGRADED
    assert any("supported by only" in reason for reason in ego.reasons)
    assert_right(ego, 3e-3, 1e-2)


def test_a_motion_contradicted_by_most_points_is_degraded() -> None:
    rng = np.random.default_rng(3)
    scene = seen(rng, 200)
    scene.px[:140] += rng.uniform(5, 60, (140, 2)) * rng.choice([-1, 1], (140, 2))
    ego = estimated(scene)
    assert ego.status is Status.DEGRADED
    assert any("%" in reason for reason in ego.reasons)
    assert_right(ego, 1e-3, 5e-3)


@pytest.mark.parametrize("right", [True, False])
def test_people_filling_the_view_do_not_degrade_a_pose_confirmed_by_odometry(right: bool) -> None:
    rng = np.random.default_rng(3)
    scene = seen(rng, 200)
    scene.px[:140] += rng.uniform(5, 60, (140, 2)) * rng.choice([-1, 1], (140, 2))
    asked = []

    def confirmed(T_current_previous: Pose) -> bool:
        asked.append(T_current_previous)
        return right

    ego = estimate_rigid_motion(scene, BEFORE, AFTER, LAB, P, 0, confirmed)
    assert ego.status is (Status.OK if right else Status.DEGRADED)
    (step,) = asked
    np.testing.assert_allclose(step.matrix, STEP.matrix, atol=5e-3)


def test_wheel_odometry_is_not_consulted_when_most_points_agree() -> None:
    def refuse(_: Pose) -> bool:
        raise AssertionError

    scene = seen(np.random.default_rng(3), 200)
    assert estimate_rigid_motion(scene, BEFORE, AFTER, LAB, P, 0, refuse).status is Status.OK


# --- the contract --------------------------------------------------------------------------


def test_equal_input_and_frame_number_give_an_identical_result() -> None:
    scene = both(
        obstacle(np.random.default_rng(0), 80, (0.05, 0, 0)), seen(np.random.default_rng(1), 120)
    )
    first, second, other = (estimated(scene, seed=n) for n in (7, 7, 8))
    assert first.T_camera_world is not None
    assert second.T_camera_world is not None
    np.testing.assert_array_equal(first.T_camera_world.matrix, second.T_camera_world.matrix)
    np.testing.assert_array_equal(first.inliers, second.inliers)
    assert first.pose_covariance is not None
    assert second.pose_covariance is not None
    np.testing.assert_array_equal(first.pose_covariance, second.pose_covariance)
    # Other samples lead to the same result.
    np.testing.assert_allclose(error_of(other), error_of(first), atol=3e-4)


def test_the_input_is_unchanged() -> None:
    scene = seen(np.random.default_rng(0), 60)
    before = {f.name: getattr(scene, f.name).copy() for f in dataclasses.fields(scene)}
    estimated(scene)
    for name, value in before.items():
        np.testing.assert_array_equal(getattr(scene, name), value)


@quick
@given(turns, shifts)
def test_static_points_are_predicted_in_the_next_image(
    turn: tuple[float, float, float], shift: tuple[float, float, float]
) -> None:
    rng = np.random.default_rng(0)
    motion = Pose.from_rotvec(turn, shift)
    scene = exactly_seen(rng, pose=motion @ BEFORE)
    ego: EgoMotion = estimated(scene)
    px, disparity = LAB.project(BEFORE.apply(scene.position))
    in_front = np.isfinite(px).all(axis=1)
    predicted = ego.predict(px[in_front], disparity[in_front])
    np.testing.assert_allclose(predicted, scene.px[in_front], atol=1e-3)


def test_unpredictable_points_are_nan() -> None:
    px = np.array([[100.0, 50.0], [300.0, 200.0]])
    ego = estimated(seen(np.random.default_rng(0)))
    predicted = ego.predict(px, np.array([8.0, np.nan]))
    assert np.isfinite(predicted[0]).all()
    assert np.isnan(predicted[1]).all()
    assert np.isnan(ego.predict(px, None)).all()
    lost = estimated(seen(np.random.default_rng(0), 3))
    assert np.isnan(lost.predict(px, np.array([8.0, 8.0]))).all()
    assert lost.homography is None
