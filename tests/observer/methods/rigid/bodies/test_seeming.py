"""Things that may move but are too uncertain to be reported, and where a body may be."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.seeming import may_fill, moving_boxes_px, seems_to_move
from observer.methods.rigid.dense.free_space import ARRIVED, STATIC, UNCOVERED
from observer.methods.rigid.dense.ground import GroundPlane
from observer.types import TrackState

from ..solid_worlds import CAMERA, HEIGHT_M, HERE, ROOM, Solid, outline_of, seen, step_to

MakeTrack = Callable[..., BodyTrack]
GROUND = GroundPlane(np.array([0.0, 1.0, 0.0]), HEIGHT_M)
PERSON_M, PATCH_M, NEAR_M = (0.45, 1.2, 0.1), (0.45, 0.6, 0.1), (0.45, 2.0, 0.1)


@pytest.fixture
def guest(make_track: MakeTrack) -> Callable[..., BodyTrack]:
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


def test_who_came_where_it_was_free_seems_to_move_however_uncertain_the_velocity(
    guest: MakeTrack,
) -> None:
    assert seems_to_move(guest(ARRIVED))
    assert not seems_to_move(guest(STATIC))
    # Static things reappear behind a passer-by.
    assert not seems_to_move(guest(UNCOVERED))


def test_a_patch_of_noise_is_no_person_and_who_fills_the_view_is_one(guest: MakeTrack) -> None:
    assert not seems_to_move(guest(size=PATCH_M))
    # At 0.9 m only 0.72 m of a person is in view.
    assert seems_to_move(guest(size=NEAR_M, distance=0.9))
    assert not seems_to_move(guest(size=(0.45, 0.3, 0.1), distance=0.9))


def test_whose_points_turned_out_to_be_those_of_limbs_may_still_move(guest: MakeTrack) -> None:
    """It may, until points are found that move as one."""
    track = guest(STATIC)
    track.loosen()
    assert seems_to_move(track)
    track.stiffen(track.filter)
    assert not seems_to_move(track)


@pytest.mark.parametrize("state", [TrackState.CONFIRMED, TrackState.COASTING])
def test_what_was_reported_does_not_seem_to_move(guest: MakeTrack, state: TrackState) -> None:
    track = guest(ARRIVED, sigma=0.1)
    assert seems_to_move(track)
    track.state = state
    assert not seems_to_move(track)


def test_an_outline_that_is_not_seen_tells_nothing(guest: MakeTrack) -> None:
    for sigma in (1.0, 0.1):
        track = guest(ARRIVED, sigma=sigma)
        track.outline.seen = False
        assert not seems_to_move(track)


@pytest.mark.parametrize(
    ("points", "significance", "seems"), [(6, 2.5, True), (3, 2.5, False), (6, 1.5, False)]
)
def test_points_seem_to_move_where_they_are_some_and_their_velocity_is_no_noise(
    make_track: MakeTrack, points: int, significance: float, seems: bool
) -> None:
    track = make_track()
    track.points, track.significance = points, significance
    assert seems_to_move(track) == seems


def test_few_points_that_surely_cross_the_view_seem_to_move(make_track: MakeTrack) -> None:
    track = make_track()
    track.points, track.significance = 3, 12.0
    assert not seems_to_move(track)
    track.crosses = True
    assert seems_to_move(track)


def head(make_track: MakeTrack) -> BodyTrack:
    """The track of some points on a head, 1.7 m above the ground and 4 m away."""
    track = make_track((0.0, HEIGHT_M - 1.7, 4.0))
    (u, v), _ = CAMERA.project(track.centre)
    track.box_px = (u - 8, v - 8, u + 8, v + 8)
    track.points, track.significance = 6, 2.5
    return track


def test_points_may_be_those_of_a_head_and_a_person_may_stand_below_it(
    make_track: MakeTrack,
) -> None:
    track = head(make_track)
    (u0, v0, u1, v1) = may_fill(track, GROUND, HERE, CAMERA)
    (_, feet), _ = CAMERA.project([0.0, HEIGHT_M, 4.0])
    assert v1 == pytest.approx(feet)
    assert v0 == pytest.approx(min(track.box_px[1], feet - 1.8 * CAMERA.fy / 4.0))
    assert u1 - u0 == pytest.approx(0.5 * CAMERA.fx / 4.0)


def test_without_ground_or_behind_the_camera_only_the_points_tell_where(
    make_track: MakeTrack,
) -> None:
    track = head(make_track)
    assert may_fill(track, None, HERE, CAMERA) == track.box_px
    behind = make_track((0.0, 0.0, -1.0))
    assert may_fill(behind, GROUND, HERE, CAMERA) == behind.box_px


def test_an_outline_may_be_that_of_a_trunk_with_legs_below_it(guest: MakeTrack) -> None:
    track = guest()
    track.box_px = (250.0, 100.0, 420.0, 200.0)
    u0, v0, u1, v1 = may_fill(track, GROUND, HERE, CAMERA)
    (_, feet), _ = CAMERA.project([0.0, HEIGHT_M, 4.0])
    assert (u0, u1, v1) == pytest.approx((250.0, 420.0, feet))
    assert v0 == pytest.approx(min(100.0, feet - 1.8 * CAMERA.fy / 4.0))


def test_points_on_somebody_who_is_reported_tell_of_nobody_beside_him(
    make_track: MakeTrack,
) -> None:
    scene, now = seen(ROOM), step_to(dt=0.1)
    part, whole = head(make_track), make_track(number=2)
    reported, seeming = moving_boxes_px([part], scene, now)
    assert (reported, seeming) == ([], [may_fill(part, scene.ground, HERE, CAMERA)])
    assert seeming != [part.box_px]
    whole.state, whole.box_px = TrackState.CONFIRMED, (250.0, 50.0, 390.0, 399.0)
    assert moving_boxes_px([part, whole], scene, now) == ([whole.box_px], [part.box_px])
    # Without dense depth the ground is unknown.
    assert moving_boxes_px([part], None, now) == ([], [part.box_px])
