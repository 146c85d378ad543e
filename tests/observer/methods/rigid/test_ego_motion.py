"""The camera's motion in space, from points and sightings generated from it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.methods.rigid.ego_motion import StaticScene, estimate_rigid_motion
from observer.parameters import EgoMotionParameters, KltTrackingParameters
from observer.types import EgoMotion, Status
from observer.vision.keypoints import density_weights
from observer.vision.rigid_ego_motion import RigidEgoMotion

from ...builders import LAB, ROAD, place_information, points_in_view

P = EgoMotionParameters(model="rigid")
quick = settings(deadline=None, max_examples=30)
SIGMA = 0.12
BEFORE = Pose.from_rotvec((0.05, -0.3, 0.02), (0.4, -0.1, 1.5))
STEP = Pose.from_rotvec((0.004, 0.02, -0.006), (0.012, -0.004, -0.03))
AFTER = STEP @ BEFORE


def seen(
    rng: np.random.Generator,
    count: int = 200,
    *,
    camera: StereoCamera = LAB,
    depths: tuple[float, float] = (1.0, 8.0),
    pose: Pose = AFTER,
    noise: float = 1.0,
    place_noise: float = 1.0,
) -> StaticScene:
    """Points of the world as a camera at the pose sees them, their places and pixels noisy.

    ``noise`` and ``place_noise`` scale the errors relative to their stated deviations.
    """
    place = points_in_view(camera, count, rng, *depths)
    px, disparity = camera.project(place)
    covariance = np.linalg.inv(place_information(camera, place, SIGMA / 2))
    error = np.einsum(
        "nij,nj->ni", np.linalg.cholesky(covariance), rng.normal(0, place_noise, (count, 3))
    )
    T_world_camera = pose.inverse()
    R = T_world_camera.rotation
    return StaticScene(
        position=T_world_camera.apply(place + error),
        covariance=R @ covariance @ R.T,
        px=px + rng.normal(0, noise * SIGMA, px.shape),
        disparity=disparity + rng.normal(0, noise * SIGMA, count),
        sigma=np.full((count, 3), SIGMA),
        weight=np.ones(count),
    )


def exactly_seen(rng: np.random.Generator, count: int = 200, pose: Pose = AFTER) -> StaticScene:
    return seen(rng, count, pose=pose, noise=0.0, place_noise=0.0)


def both(first: StaticScene, second: StaticScene) -> StaticScene:
    return StaticScene(
        *(
            np.concatenate([getattr(first, f.name), getattr(second, f.name)])
            for f in dataclasses.fields(StaticScene)
        )
    )


def but(scene: StaticScene, **changes: Float64Array) -> StaticScene:
    return dataclasses.replace(scene, **changes)


def obstacle(
    rng: np.random.Generator, count: int, moved: tuple[float, float, float]
) -> StaticScene:
    """A textured board at 1.5 m that is displaced, as the camera at ``AFTER`` sees it."""
    place = rng.uniform((-0.3, -0.3, 1.45), (0.3, 0.3, 1.55), (count, 3))
    px, disparity = LAB.project(place + moved)
    covariance = np.linalg.inv(place_information(LAB, place, SIGMA / 2))
    T_world_camera = AFTER.inverse()
    return StaticScene(
        position=T_world_camera.apply(place),
        covariance=T_world_camera.rotation @ covariance @ T_world_camera.rotation.T,
        px=px + rng.normal(0, SIGMA, px.shape),
        disparity=disparity + rng.normal(0, SIGMA, count),
        sigma=np.full((count, 3), SIGMA),
        weight=np.ones(count),
    )


def estimated(
    scene: StaticScene,
    *,
    camera: StereoCamera = LAB,
    expected: Pose = BEFORE,
    parameters: EgoMotionParameters = P,
    seed: int = 1,
) -> RigidEgoMotion:
    return estimate_rigid_motion(scene, BEFORE, expected, camera, parameters, seed)


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


def error_of(ego: RigidEgoMotion, truth: Pose = AFTER) -> Float64Array:
    """(6,) rotation vector (rad) and translation (m) by which the pose is off, camera axes."""
    assert ego.T_camera_world is not None
    off = ego.T_camera_world @ truth.inverse()
    return np.concatenate([off.rotvec, off.translation])


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


# --- uncertainty ---------------------------------------------------------------------------


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
