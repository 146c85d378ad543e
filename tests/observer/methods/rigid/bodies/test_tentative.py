"""Things that may move but are too uncertain to be reported, and where a body may be."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.tentative import may_fill, may_move, moving_boxes_px
from observer.methods.rigid.dense.free_space import ARRIVED, STATIC, UNCOVERED
from observer.methods.rigid.dense.ground import GroundPlane
from observer.types import TrackState

from ..solid_worlds import CAMERA, HEIGHT_M, HERE, ROOM, Solid, outline_of, seen, step_to

MakeTrack = Callable[..., BodyTrack]
GROUND = GroundPlane(np.array([0.0, 1.0, 0.0]), HEIGHT_M)
PERSON_M, PATCH_M, NEAR_M = (0.45, 1.2, 0.1), (0.45, 0.6, 0.1), (0.45, 2.0, 0.1)


@pytest.fixture
def track_with(make_track: MakeTrack) -> Callable[..., BodyTrack]:
    """Gives the track of an outline with one kind of evidence and a very uncertain velocity."""

    def make(
        evidence: int = ARRIVED,
        size: Sequence[float] = PERSON_M,
        distance: float = 4.0,
        sigma: float = 1.0,
    ) -> BodyTrack:
        track = make_track((0.0, 0.0, distance), (0.5, 0.0, 0.0), sigma=sigma)
        track.outline = outline_of(Solid((0.0, 0.0, distance), size), evidence)
        track.significance, track.rigid = 0.5 / sigma, False
        return track

    return make


def test_a_body_that_entered_free_space_may_move_however_uncertain(
    track_with: MakeTrack,
) -> None:
    assert may_move(track_with(ARRIVED))
    assert not may_move(track_with(STATIC))
    # Static things reappear behind a passer-by.
    assert not may_move(track_with(UNCOVERED))


def test_only_a_person_sized_patch_may_move(
    track_with: MakeTrack,
) -> None:
    assert not may_move(track_with(size=PATCH_M))
    # At 0.9 m only 0.72 m of a person is in view.
    assert may_move(track_with(size=NEAR_M, distance=0.9))
    assert not may_move(track_with(size=(0.45, 0.3, 0.1), distance=0.9))


def test_a_body_whose_points_were_on_limbs_may_still_move(track_with: MakeTrack) -> None:
    """It may, until points are found that move as one."""
    track = track_with(STATIC)
    track.loosen()
    assert may_move(track)
    track.stiffen(track.filter)
    assert not may_move(track)


@pytest.mark.parametrize("state", [TrackState.CONFIRMED, TrackState.COASTING])
def test_a_reported_body_is_not_tentative(track_with: MakeTrack, state: TrackState) -> None:
    track = track_with(ARRIVED, sigma=0.1)
    assert may_move(track)
    track.state = state
    assert not may_move(track)


def test_an_unseen_outline_gives_no_evidence(track_with: MakeTrack) -> None:
    for sigma in (1.0, 0.1):
        track = track_with(ARRIVED, sigma=sigma)
        track.outline.seen = False
        assert not may_move(track)


@pytest.mark.parametrize(
    ("points", "significance", "moves"), [(6, 2.5, True), (3, 2.5, False), (6, 1.5, False)]
)
def test_several_points_with_a_significant_velocity_may_move(
    make_track: MakeTrack, points: int, significance: float, moves: bool
) -> None:
    track = make_track()
    track.points, track.significance = points, significance
    assert may_move(track) == moves


def test_few_points_certainly_crossing_the_view_may_move(make_track: MakeTrack) -> None:
    track = make_track()
    track.points, track.significance = 3, 12.0
    assert not may_move(track)
    track.crosses = True
    assert may_move(track)


def head(make_track: MakeTrack) -> BodyTrack:
    """The track of some points on a head, 1.7 m above the ground and 4 m away."""
    track = make_track((0.0, HEIGHT_M - 1.7, 4.0))
    (u, v), _ = CAMERA.project(track.centre)
    track.box_px = (u - 8, v - 8, u + 8, v + 8)
    track.points, track.significance = 6, 2.5
    return track


def test_points_may_belong_to_the_head_of_a_person(
    make_track: MakeTrack,
) -> None:
    track = head(make_track)
    (u0, v0, u1, v1) = may_fill(track, GROUND, HERE, CAMERA)
    (_, feet), _ = CAMERA.project([0.0, HEIGHT_M, 4.0])
    assert v1 == pytest.approx(feet)
    assert v0 == pytest.approx(min(track.box_px[1], feet - 1.8 * CAMERA.fy / 4.0))
    assert u1 - u0 == pytest.approx(0.5 * CAMERA.fx / 4.0)


def test_only_the_points_are_marked_without_ground_or_behind_the_camera(
    make_track: MakeTrack,
) -> None:
    track = head(make_track)
    assert may_fill(track, None, HERE, CAMERA) == track.box_px
    behind = make_track((0.0, 0.0, -1.0))
    assert may_fill(behind, GROUND, HERE, CAMERA) == behind.box_px


def test_an_outline_may_be_a_trunk_with_legs_below_it(track_with: MakeTrack) -> None:
    track = track_with()
    track.box_px = (250.0, 100.0, 420.0, 200.0)
    u0, v0, u1, v1 = may_fill(track, GROUND, HERE, CAMERA)
    (_, feet), _ = CAMERA.project([0.0, HEIGHT_M, 4.0])
    assert (u0, u1, v1) == pytest.approx((250.0, 420.0, feet))
    assert v0 == pytest.approx(min(100.0, feet - 1.8 * CAMERA.fy / 4.0))


def test_points_on_a_reported_person_are_not_a_second_person(
    make_track: MakeTrack,
) -> None:
    scene, now = seen(ROOM), step_to(dt=0.1)
    part, whole = head(make_track), make_track(number=2)
    reported, tentative = moving_boxes_px([part], scene, now)
    assert (reported, tentative) == ([], [may_fill(part, scene.ground, HERE, CAMERA)])
    assert tentative != [part.box_px]
    whole.state, whole.box_px = TrackState.CONFIRMED, (250.0, 50.0, 390.0, 399.0)
    assert moving_boxes_px([part, whole], scene, now) == ([whole.box_px], [part.box_px])
    # Without dense depth the ground is unknown.
    assert moving_boxes_px([part], None, now) == ([], [part.box_px])
