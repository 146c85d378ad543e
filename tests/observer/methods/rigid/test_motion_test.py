"""The motion test: declared false-alarm rates, and motion that no single point shows."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binom

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose, cross_matrix
from observer.methods.rigid.camera_step import CameraStep
from observer.methods.rigid.motion_test import group_dynamic, pooled_motion
from observer.methods.rigid.point_motion import PooledMotion
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.parameters import EvidenceParameters
from observer.vision.camera_rate import CameraRate

from ...builders import LAB, ROAD, points_in_view, watched

P = EvidenceParameters()
quick = settings(deadline=None, max_examples=20)
DT = 1 / 15
STILL = np.zeros((6, 6))
HERE = Pose.identity()
# Rad and metres: typical frame-to-frame uncertainty of a pose.
STEP_STD = np.array([2e-4, 2e-4, 2e-4, 1e-3, 1e-3, 1e-3])


def pooled(
    points: TrackedPoints,
    *,
    camera: StereoCamera = LAB,
    step_covariance: Float64Array = STILL,
    dt: float = DT,
    parameters: EvidenceParameters = P,
    pose: Pose = HERE,
    rate: CameraRate | None = None,
) -> PooledMotion:
    now = CameraStep(camera, pose, step_covariance, rate or CameraRate.still(), dt)
    return pooled_motion(points, now, parameters)


def board(
    rng: np.random.Generator,
    depth: float = 3.0,
    side_px: float = 60.0,
    count: int = 16,
    centre_px: tuple[float, float] = (256.0, 128.0),
    camera: StereoCamera = LAB,
) -> Float64Array:
    """(N, 3) points of a flat board that faces the camera, ``side_px`` pixels wide and high."""
    px = np.array(centre_px) + rng.uniform(-side_px / 2, side_px / 2, (count, 2))
    return camera.triangulate(px, np.full(count, camera.fx * camera.baseline / depth))


def alone(information: Float64Array, velocity: Float64Array) -> Float64Array:
    """(N,) significance of each point's own velocity."""
    return np.sqrt(np.einsum("ni,nij,nj->n", velocity, information, velocity))


# --- false alarms --------------------------------------------------------------------------


def ground(camera: StereoCamera, count: int, rng: np.random.Generator) -> Float64Array:
    """(N, 3) points on a floor from 1 m to 8 m ahead of a camera with a baseline of 0.12 m."""
    px = rng.uniform((8, 8), (camera.width - 9, camera.height - 9), (count, 2))
    near, far = camera.baseline / 0.12, 8 * camera.baseline / 0.12
    steepness = (px[:, 1] - 8) / (camera.height - 17)
    inverse = 1 / far + (1 / near - 1 / far) * steepness
    return camera.triangulate(px, camera.fx * camera.baseline * inverse)


def alarm_rate(
    draws: int,
    parameters: EvidenceParameters,
    *,
    step_std: Float64Array | None = None,
    stated_cov: Float64Array = STILL,
    camera: StereoCamera = LAB,
    memory_s: float = 0.5,
) -> float:
    """Share of frames of a static scene in which anything counts as dynamic."""
    alarms = 0
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        points = watched(
            camera, ground(camera, 150, rng), np.zeros(3), rng,
            frames=6, step_std=step_std, memory_s=memory_s,
        )  # fmt: skip
        motion = pooled(points, camera=camera, step_covariance=stated_cov, parameters=parameters)
        alarms += bool(motion.dynamic.any())
    return alarms / draws


def likely(rate: float, draws: int) -> tuple[float, float]:
    """Bounds of the share of alarms in ``draws`` frames, exceeded once in a thousand cases."""
    low, high = np.asarray(binom.ppf([0.0005, 0.9995], draws, rate)) / draws
    return float(low), float(high)


@pytest.mark.parametrize("rate", [0.05, 0.4])
def test_false_alarms_occur_at_the_declared_rate(rate: float) -> None:
    """If all assumptions hold: independent errors, and nothing is forgotten."""
    draws = 120
    p = P.model_copy(
        update={"false_alarms_per_frame": rate, "noise_correlation": 0.0, "min_points": 1}
    )
    low, high = likely(rate, draws)
    assert low / 2 <= alarm_rate(draws, p, memory_s=1e9) <= 1.3 * high


@pytest.mark.parametrize("camera", [LAB, ROAD])
def test_false_alarms_do_not_exceed_the_declared_rate_by_default(camera: StereoCamera) -> None:
    draws, rate = 120, 0.05
    p = P.model_copy(update={"false_alarms_per_frame": rate})
    assert alarm_rate(draws, p, camera=camera) <= likely(rate, draws)[1]


def test_a_stated_pose_error_causes_no_false_alarms() -> None:
    draws, rate = 120, 0.05
    p = P.model_copy(update={"false_alarms_per_frame": rate})
    alarms = alarm_rate(draws, p, step_std=5 * STEP_STD, stated_cov=np.diag((5 * STEP_STD) ** 2))
    assert alarms <= likely(rate, draws)[1]
    assert alarm_rate(20, p, step_std=5 * STEP_STD) > 0.5


def test_the_threshold_follows_from_the_declared_rate() -> None:
    points = watched(
        LAB,
        points_in_view(LAB, 100, np.random.default_rng(0), 1, 8),
        np.zeros(3),
        np.random.default_rng(1),
    )
    strict, lax = (
        pooled(points, parameters=P.model_copy(update={"false_alarms_per_frame": rate})).threshold
        for rate in (1e-6, 0.1)
    )
    assert strict > lax + 1
    few = points.take(np.arange(10))
    assert pooled(few).threshold < pooled(points).threshold


# --- detection -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("velocity", "frames", "sigma_px"),
    [((0.1, 0, 0), 3, 0.35), ((0, 0, 0.25), 7, 0.12), ((0, 0, -0.2), 8, 0.12)],
    ids=["aside", "away", "towards"],
)
def test_motion_too_small_for_single_points_is_found_by_pooling(
    velocity: tuple[float, float, float], frames: int, sigma_px: float
) -> None:
    seen, single = [], []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        place = board(rng, depth=3.5, side_px=36, count=30)
        points = watched(LAB, place, np.array(velocity), rng, frames=frames, sigma_px=sigma_px)
        motion = pooled(points)
        seen.append(motion.dynamic.mean())
        single.append(
            np.mean(alone(motion.own_information, motion.own_velocity) > motion.threshold)
        )
        error = motion.velocity - velocity
        nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(motion.covariance), error)
        assert np.median(nees) < 12
    assert np.mean(seen) > 0.9
    assert np.mean(single) < 0.3


def test_the_background_around_moving_points_stays_static() -> None:
    rng = np.random.default_rng(1)
    moving = board(rng, depth=2.0, count=20)
    wall = points_in_view(LAB, 150, rng, 4.0, 6.0)
    place = np.concatenate([moving, wall])
    velocity = np.zeros_like(place)
    velocity[:20] = (0.3, 0.0, 0.1)
    motion = pooled(watched(LAB, place, velocity, rng))
    assert motion.dynamic[:20].mean() > 0.9
    assert not motion.dynamic[20:].any()
    np.testing.assert_allclose(
        motion.velocity[:20][motion.dynamic[:20]].mean(axis=0), (0.3, 0.0, 0.1), atol=0.04
    )


def test_motion_is_found_for_any_camera_pose() -> None:
    """World axes differ from the camera's."""
    rng = np.random.default_rng(2)
    place, velocity = board(rng), np.array([0.2, 0.0, 0.1])
    T_camera_world = Pose.from_rotvec((0.1, 2.0, -0.3), (4.0, -1.0, 2.0))
    points = watched(LAB, place, velocity, np.random.default_rng(3))
    sums, R = points.sums, T_camera_world.rotation
    back = T_camera_world.inverse()
    turned = points.but(sums=type(sums)(
        origin=back.apply(sums.origin),
        a0=R.T @ sums.a0 @ R, a1=R.T @ sums.a1 @ R, a2=R.T @ sums.a2 @ R,
        b0=sums.b0 @ R, b1=sums.b1 @ R, c0=sums.c0, count=sums.count,
    ))  # fmt: skip
    step = np.diag(STEP_STD**2)
    same = pooled(turned, pose=T_camera_world, step_covariance=step)
    straight = pooled(points, step_covariance=step)
    np.testing.assert_allclose(same.significance, straight.significance, rtol=1e-5)
    np.testing.assert_allclose(same.velocity, back.rotate(straight.velocity), atol=1e-6)


# --- errors that all points share ----------------------------------------------------------


def test_the_pose_error_does_not_average_away() -> None:
    """However many points are pooled, the uncertainty of the camera's own motion remains."""
    step = np.diag((10 * STEP_STD) ** 2)
    spread = {}
    for count in (4, 100):
        rng = np.random.default_rng(count)
        place = board(rng, side_px=20, count=count)
        points = watched(LAB, place, np.zeros(3), rng)
        exact, unsure = pooled(points), pooled(points, step_covariance=step)
        added = unsure.covariance - exact.covariance
        at = unsure.position[0]
        G = np.concatenate([-cross_matrix(at), np.eye(3)], axis=1)
        spread[count] = np.trace(added[0])
        # At least as much as if the window consisted of independent steps.
        floor = np.trace(G @ step @ G.T) / (DT * points.sums.window_s()[0])
        assert spread[count] > 0.9 * floor
        assert np.linalg.eigvalsh(added[0]).min() > 0
    assert spread[100] == pytest.approx(spread[4], rel=0.1)


def test_more_points_do_not_turn_the_pose_error_into_motion() -> None:
    step_std = 10 * STEP_STD
    for count in (6, 60):
        worst = []
        for seed in range(25):
            rng = np.random.default_rng(seed)
            points = watched(
                LAB, board(rng, side_px=24, count=count), np.zeros(3), rng, step_std=step_std
            )
            motion = pooled(points, step_covariance=np.diag(step_std**2))
            worst.append(motion.significance.max() / motion.threshold)
            blind = pooled(points)
        assert max(worst) < 1
        if count == 60:
            assert blind.significance.max() > blind.threshold


def test_a_stretched_edge_of_the_image_is_not_motion() -> None:
    """As at the edge of KITTI's images, where hedges pass 3 % faster than they should."""
    rng, rate = np.random.default_rng(6), CameraRate(np.zeros(3), np.array([0.0, 0.0, -12.0]))
    edge = board(rng, depth=12.0, side_px=50, count=20, centre_px=(60.0, 200.0), camera=ROAD)
    passes = rate.lasting_errors(edge, np.zeros_like(edge), ROAD, 0, 1)[:, 1]
    points = watched(ROAD, edge, P.distortion_sigma * passes, rng, frames=12)
    assert not pooled(points, camera=ROAD, rate=rate).dynamic.any()
    strict = P.model_copy(update={"distortion_sigma": 0.0})
    assert pooled(points, camera=ROAD, rate=rate, parameters=strict).dynamic.any()
    # With a camera at rest, or for such speeds in the middle of the image, it is motion.
    assert pooled(points, camera=ROAD, rate=CameraRate.still()).dynamic.any()
    middle = board(rng, depth=12.0, side_px=50, count=20, centre_px=(600.0, 200.0), camera=ROAD)
    points = watched(ROAD, middle, P.distortion_sigma * passes, rng, frames=12)
    assert pooled(points, camera=ROAD, rate=rate).dynamic.mean() > 0.8


@pytest.mark.parametrize("untold", ["recurs", "cornered"])
def test_texture_that_recurs_or_is_only_an_edge_is_no_evidence_of_motion(untold: str) -> None:
    rng = np.random.default_rng(4)
    points = watched(LAB, board(rng, side_px=20, count=40), np.array([0.2, 0, 0]), rng)
    assert pooled(points).dynamic.all()
    points = points.but(**{untold: np.full(len(points), untold == "recurs")})
    assert not pooled(points).dynamic.any()
    assert not pooled(points).judged.any()


def test_shared_errors_of_neighbours_lower_the_significance() -> None:
    rng = np.random.default_rng(4)
    points = watched(LAB, board(rng, side_px=20, count=40), np.array([0.2, 0, 0]), rng)
    independent = pooled(points, parameters=P.model_copy(update={"noise_correlation": 0.0}))
    shared = pooled(points)
    assert (shared.significance < 0.7 * independent.significance).all()


# --- scale ---------------------------------------------------------------------------------


@quick
@given(st.floats(0.05, 50.0))
def test_the_result_does_not_depend_on_the_scale_of_the_world(scale: float) -> None:
    """The lab at 3 m and a road at 60 m, seen by a camera scaled by the same factor."""
    camera = StereoCamera(512, 256, 443.0, 443.0, 255.5, 127.5, 0.12 * scale)
    step = np.diag(STEP_STD**2 * [1, 1, 1, *[scale**2] * 3])
    rng = np.random.default_rng(5)
    wall = points_in_view(LAB, 60, rng, 4.0, 6.0)
    place = np.concatenate([board(rng), wall])
    velocity = np.zeros_like(place)
    velocity[:16] = (0.15, 0.0, 0.1)
    lab = pooled(
        watched(LAB, place, velocity, np.random.default_rng(6)),
        step_covariance=np.diag(STEP_STD**2),
    )
    big = pooled(
        watched(camera, scale * place, scale * velocity, np.random.default_rng(6)),
        camera=camera, step_covariance=step,
    )  # fmt: skip
    np.testing.assert_allclose(big.significance, lab.significance, rtol=1e-3, atol=1e-3)
    np.testing.assert_array_equal(big.neighbours, lab.neighbours)
    np.testing.assert_array_equal(big.dynamic, lab.dynamic)
    np.testing.assert_allclose(big.velocity / scale, lab.velocity, atol=1e-4)
    assert lab.dynamic[:16].any()


@pytest.mark.parametrize(
    ("camera", "depth", "speed", "dt", "side_px"),
    [(LAB, 3.0, 0.3, 1 / 15, 50.0), (ROAD, 60.0, 15.0, 0.1, 24.0), (ROAD, 15.0, 3.0, 0.1, 60.0)],
    ids=["robot at 3 m", "car at 60 m", "bicycle at 15 m"],
)
@pytest.mark.parametrize("along", [(1.0, 0.0, 0.0), (0.0, 0.0, -1.0)], ids=["aside", "towards"])
def test_the_same_parameters_work_in_the_lab_and_on_the_road(
    camera: StereoCamera,
    depth: float,
    speed: float,
    dt: float,
    side_px: float,
    along: tuple[float, float, float],
) -> None:
    rng = np.random.default_rng(7)
    place = board(rng, depth, side_px, 20, (camera.cx + 30, camera.cy), camera)
    velocity = speed * np.array(along)
    points = watched(camera, place, velocity, rng, frames=8, dt=dt)
    motion = pooled(points, camera=camera, dt=dt, step_covariance=np.diag(STEP_STD**2))
    assert motion.dynamic.mean() > 0.9
    np.testing.assert_allclose(np.median(motion.velocity, axis=0), velocity, atol=0.25 * speed)


# --- what is judged, and on which evidence ------------------------------------------------


def test_points_with_too_few_sightings_are_not_judged() -> None:
    rng = np.random.default_rng(8)
    points = watched(LAB, board(rng), np.array([1.0, 0, 0]), rng)
    sightings = points.sightings.copy()
    sightings[::2] = P.min_sightings - 1
    motion = pooled(points.but(sightings=sightings))
    assert not motion.judged[::2].any()
    assert motion.judged[1::2].all()
    assert not motion.dynamic[::2].any()
    assert (motion.significance[::2] == 0).all()
    assert motion.dynamic[1::2].all()
    assert not np.isin(motion.pairs, np.arange(0, 16, 2)).any()


def test_points_measured_at_a_single_instant_are_not_judged() -> None:
    """Seen ever since, but without depth: differences of its sums are rounding errors."""
    rng = np.random.default_rng(11)
    place = board(rng, count=400, side_px=200)
    points = watched(LAB, place, np.zeros(3), rng, frames=1)
    points, sums = points.but(sightings=np.full(len(place), 9)), points.sums
    for dt in rng.uniform(0.03, 0.1, 12):
        sums = sums.advanced(dt, P.memory_s)
        sums = sums.with_sightings(np.full_like(place, np.nan), np.zeros((len(place), 3, 3)))
        motion = pooled(points.but(sums=sums))
        assert not motion.judged.any()
        assert np.isfinite(motion.covariance).all()


def test_points_seen_once_give_finite_but_unjudged_motion() -> None:
    rng = np.random.default_rng(9)
    points = watched(LAB, board(rng), np.zeros(3), rng, frames=1)
    motion = pooled(points.but(sightings=np.full(16, 5, np.int64)))
    assert not motion.judged.any()
    assert not motion.dynamic.any()
    assert np.isfinite(motion.velocity).all()


@pytest.mark.parametrize("count", [0, 1, 2])
def test_one_or_two_points_are_not_enough_evidence(count: int) -> None:
    rng = np.random.default_rng(10)
    points = watched(LAB, board(rng, count=count), np.array([1.0, 0, 0]), rng)
    motion = pooled(points)
    assert motion.dynamic.shape == (count,)
    assert not motion.dynamic.any()
    assert (motion.significance > motion.threshold).all()
    assert group_dynamic(motion, np.ones(count, np.bool_), 1).tolist() == [-1] * count


def test_neighbours_are_near_in_the_image_and_in_depth() -> None:
    rng = np.random.default_rng(11)
    near, behind = board(rng, 1.5, 20, 10), board(rng, 5.0, 20, 10)
    aside = board(rng, 1.5, 20, 10, centre_px=(256 + 20 + 2 * P.radius_px, 128))
    points = watched(LAB, np.concatenate([near, behind, aside]), np.zeros(3), rng)
    motion = pooled(points)
    group = np.repeat([0, 1, 2], 10)
    assert (group[motion.pairs[:, 0]] == group[motion.pairs[:, 1]]).all()
    assert motion.neighbours.tolist() == [
        1 + int((motion.pairs == n).sum()) for n in range(len(points))
    ]
    assert (motion.neighbours >= 8).all()


# --- groups --------------------------------------------------------------------------------


def crossing() -> tuple[PooledMotion, np.ndarray]:
    """Two boards side by side that move apart, and a third one elsewhere; which point is whose."""
    rng = np.random.default_rng(12)
    boards = (
        board(rng, 2.0, 40, 16, (200, 120)),
        board(rng, 2.0, 40, 12, (236, 120)),
        board(rng, 2.0, 40, 8, (400, 120)),
    )
    sizes = [len(b) for b in boards]
    velocities = np.array([[0.4, 0, 0], [-0.4, 0, 0], [0.4, 0, 0]])
    place, owner = np.concatenate(boards), np.repeat([0, 1, 2], sizes)
    return pooled(watched(LAB, place, velocities[owner], rng)), owner


def test_groups_share_position_and_velocity_and_the_largest_is_first() -> None:
    motion, owner = crossing()
    assert motion.dynamic.mean() > 0.9
    groups = group_dynamic(motion, np.ones(len(owner), np.bool_), 3)
    grouped = groups >= 0
    np.testing.assert_array_equal(groups[grouped], owner[grouped])
    assert set(groups[grouped].tolist()) == {0, 1, 2}
    assert not grouped[~motion.dynamic].any()


def test_only_free_points_are_grouped_and_small_groups_are_dropped() -> None:
    motion, owner = crossing()
    free = owner != 0
    groups = group_dynamic(motion, free, 3)
    assert (groups[~free] == -1).all()
    grouped = groups >= 0
    np.testing.assert_array_equal(groups[grouped], owner[grouped] - 1)
    assert not (group_dynamic(motion, np.ones(len(owner), np.bool_), 17) >= 0).any()
    large = group_dynamic(motion, np.ones(len(owner), np.bool_), 10)
    assert set(large.tolist()) - {-1} == {0, 1}
    assert (group_dynamic(motion, np.zeros(len(owner), np.bool_), 1) == -1).all()
