"""Bodies with limbs: told from rigid ones by their points, and measured by their trunks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import VELOCITY, YAW_RATE
from observer.methods.rigid.bodies.limbs import (
    judge_rigidity,
    measure_trunk,
    points_show_whole,
)
from observer.methods.rigid.bodies.outline import Outline
from observer.methods.rigid.dense.segments import segment_of
from observer.methods.rigid.position_velocity_filter import PositionVelocityFilter
from observer.methods.rigid.tracked_points import TrackedPoints, WorldSightings

from ..solid_worlds import ROOM, Solid, cells_of, seen

MakeTrack = Callable[..., BodyTrack]
DT = 1 / 15
SIGMA_M = 0.01
WALK = np.array([0.9, 0.0, 0.3])


def with_outline(
    track: BodyTrack, size: tuple[float, float, float] = (0.45, 1.2, 0.1)
) -> BodyTrack:
    thing = Solid((0.0, 0.0, 4.0), size)
    scene = seen([*ROOM, thing])
    track.outline = Outline.of(segment_of(scene, cells_of(thing, [*ROOM, thing])), scene)
    return track


@pytest.fixture
def upright(make_track: MakeTrack) -> BodyTrack:
    """Stands for a person; its velocity is not known yet."""
    return with_outline(make_track((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), sigma=0.5))


def on_outline(track: BodyTrack, heights: Float64Array, moved: Float64Array) -> TrackedPoints:
    """Points (N,) at shares of the outline's height from its top, that went (N, 3) m in a frame."""
    assert track.outline is not None
    u0, v0, u1, v1 = track.outline.box_px
    across = np.linspace(u0, u1, len(heights))
    px = np.stack([across, v0 + heights * (v1 - v0)], axis=1).astype(np.float32)
    sums = PositionVelocityFilter.begin(np.zeros((len(px), 3)), np.zeros((len(px), 3, 3)))
    return TrackedPoints.begin(0, px, px, np.full(len(px), 15.0), sums).but(moved=moved)


def measured(
    track: BodyTrack, heights: Float64Array, velocity: Float64Array, seed: int = 0
) -> Float64Array:
    """(3,) m/s, the body's velocity after one frame with points of velocities (N, 3)."""
    noise = np.random.default_rng(seed).normal(0, SIGMA_M, velocity.shape) * np.sqrt(2)
    points = on_outline(track, heights, velocity * DT + noise)
    information = np.broadcast_to(np.eye(3) / SIGMA_M**2, (len(points), 3, 3))
    sightings = WorldSightings(np.zeros((len(points), 3)), information)
    measure_trunk(track, np.arange(len(points)), points, sightings, DT)
    return np.asarray(track.mean[VELOCITY])


# --- the trunk's velocity ------------------------------------------------------------------


def test_the_velocity_is_that_of_the_trunk(upright: BodyTrack) -> None:
    heights = np.linspace(0.05, 0.55, 40)
    before = np.trace(upright.filter.covariance[VELOCITY, VELOCITY])
    found = measured(upright, heights, np.tile(WALK, (40, 1)))
    np.testing.assert_allclose(found, WALK, atol=0.25)
    assert np.trace(upright.filter.covariance[VELOCITY, VELOCITY]) < 0.2 * before


def test_swinging_legs_change_nothing_at_all(make_track: MakeTrack) -> None:
    trunk, legs = np.linspace(0.05, 0.55, 20), np.linspace(0.65, 0.99, 30)
    velocity = np.tile(WALK, (50, 1))
    found = []
    for swing in (0.0, 2.0, -2.0):
        track = with_outline(make_track((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), sigma=0.5))
        velocity[20:, 0] = WALK[0] + swing
        found.append(measured(track, np.concatenate([trunk, legs]), velocity))
    np.testing.assert_array_equal(found[1], found[0])
    np.testing.assert_array_equal(found[2], found[0])


@pytest.mark.parametrize("swing", [-2.0, 2.0])
def test_a_swinging_arm_before_the_trunk_hardly_changes_it(
    upright: BodyTrack, swing: float
) -> None:
    velocity = np.tile(WALK, (40, 1))
    velocity[::5, 0] += swing
    found = measured(upright, np.linspace(0.05, 0.55, 40), velocity)
    np.testing.assert_allclose(found, WALK, atol=0.25)


def test_points_that_disagree_make_it_less_sure(make_track: MakeTrack) -> None:
    heights, spread = np.linspace(0.05, 0.55, 40), []
    for scatter in (0.0, 0.8):
        track = with_outline(make_track((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), sigma=0.5))
        jitter = np.random.default_rng(1).normal(0, scatter, (40, 3))
        measured(track, heights, WALK + jitter)
        spread.append(np.trace(track.filter.covariance[VELOCITY, VELOCITY]))
    assert spread[1] > 1.5 * spread[0]


def test_what_moves_quite_unlike_a_body_that_is_known_hardly_counts(make_track: MakeTrack) -> None:
    """Far from its velocity it is rather that of a limb."""
    track = with_outline(make_track((0.0, 0.0, 4.0), tuple(WALK), sigma=0.1))
    found = measured(track, np.linspace(0.05, 0.55, 10), WALK + np.tile([3.0, 0.0, 0.0], (10, 1)))
    assert np.linalg.norm(found - WALK) < 0.1


def test_a_few_points_measure_nothing(upright: BodyTrack) -> None:
    before = upright.filter
    measured(upright, np.array([0.1, 0.2, 0.3]), np.tile(WALK, (3, 1)))
    assert upright.filter is before


def test_points_seen_for_the_first_time_measure_nothing(upright: BodyTrack) -> None:
    before = upright.filter
    measured(upright, np.linspace(0.1, 0.5, 20), np.full((20, 3), np.nan))
    assert upright.filter is before


# --- rigid or not --------------------------------------------------------------------------

ALONG, APART = np.ones(20, np.bool_), np.zeros(20, np.bool_)


def judged(track: BodyTrack, frames: int, moves_along: NDArray[np.bool_]) -> BodyTrack:
    for _ in range(frames):
        judge_rigidity(track, moves_along)
    return track


def test_a_body_all_of_whose_points_move_along_stays_rigid(upright: BodyTrack) -> None:
    assert judged(upright, 100, ALONG).rigid
    assert upright.rigidity == pytest.approx(1.0)


def test_a_body_most_of_whose_points_move_along_stays_rigid(upright: BodyTrack) -> None:
    most = ALONG.copy()
    most[:6] = False
    assert judged(upright, 100, most).rigid


def test_an_upright_body_whose_points_move_by_themselves_has_limbs(upright: BodyTrack) -> None:
    upright.filter.means[:, YAW_RATE] = 0.4
    assert judged(upright, 1, APART).rigid
    assert not judged(upright, 4, APART).rigid
    assert upright.yaw_rate == 0.0


def test_who_has_limbs_keeps_them(upright: BodyTrack) -> None:
    judged(upright, 10, APART)
    assert not judged(upright, 100, ALONG).rigid


def test_what_lies_is_rigid_whatever_its_points_do(make_track: MakeTrack) -> None:
    track = with_outline(make_track(), size=(0.8, 0.4, 0.1))
    assert judged(track, 50, APART).rigid


def shown_over(track: BodyTrack, height: float, width: float, points: int = 20) -> BodyTrack:
    """Whose points lie over such shares of its outline."""
    assert track.outline is not None
    u0, v0, u1, v1 = track.outline.box_px
    track.box_px = (u0, v0, u0 + width * (u1 - u0), v0 + height * (v1 - v0))
    track.points = points
    return track


def test_points_all_over_its_outline_show_a_body_whole(upright: BodyTrack) -> None:
    assert points_show_whole(shown_over(upright, 0.9, 0.9), upright.outline)


@pytest.mark.parametrize(
    ("height", "width", "points"), [(0.4, 0.9, 20), (0.9, 0.3, 20), (0.9, 0.9, 5)]
)
def test_points_on_a_part_of_it_or_few_do_not(
    upright: BodyTrack, height: float, width: float, points: int
) -> None:
    assert not points_show_whole(shown_over(upright, height, width, points), upright.outline)


def test_points_never_show_a_body_with_limbs_whole(upright: BodyTrack) -> None:
    upright.loosen()
    assert not points_show_whole(shown_over(upright, 1.0, 1.0), upright.outline)


def test_without_points_to_judge_by_a_body_stays_rigid_only_while_they_show_it_whole(
    make_track: MakeTrack,
) -> None:
    few = np.ones(2, np.bool_)
    for height, rigid in ((1.0, True), (0.3, False)):
        track = shown_over(with_outline(make_track()), height, 1.0)
        assert judged(track, 10, few).rigid is rigid
