"""The motion test: motion that no single point shows, at any scale, and groups of moving points."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.methods.rigid.motion_test import group_dynamic
from observer.methods.rigid.point_motion import PooledMotion

from ...builders import LAB, ROAD, points_in_view, watched
from .pooled_motion import STEP_STD, P, board, pooled

quick = settings(max_examples=20)


def alone(information: Float64Array, velocity: Float64Array) -> Float64Array:
    """(N,) significance of each point's own velocity."""
    return np.sqrt(np.einsum("ni,nij,nj->n", velocity, information, velocity))


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
