"""Which points and which segments belong to which body, in worlds of boxes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import POSITION, VELOCITY, BodyFilter
from observer.methods.rigid.bodies.segment_tracking import without_segments
from observer.methods.rigid.dense.free_space import STATIC
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.types import TrackState
from observer.vision.lifecycle import NO_OBSTACLE, TrackIds

from ..solid_worlds import (
    CAMERA,
    DT,
    GRID,
    HEIGHT_M,
    ROOM,
    Solid,
    arrived,
    cells_of,
    outlined,
    patch,
    person,
    points_on,
    seen,
    tracked,
)
from ..solid_worlds import step_to as now_at

MakeTrack = Callable[..., BodyTrack]
NEAR_WALL = Solid((0.0, -0.5, 4.0), (4.0, 1.5, 0.1))


def test_points_on_an_outline_are_assigned_to_its_track() -> None:
    tracks: list[BodyTrack] = []
    on, beside = patch(0.1, 0.0, 3.87), patch(1.0, 0.0, 7.9)
    points = points_on(on, beside).but(obstacle=np.full(18, NO_OBSTACLE))
    points = tracked(tracks, points, arrived(person(0.1, 4.0)))
    (track,) = tracks
    assert points.within.tolist() == [track.id] * 9 + [NO_OBSTACLE] * 9


def test_a_segment_containing_points_of_a_body_is_that_body(make_track: MakeTrack) -> None:
    track = make_track((0.1, 0.0, 3.9), number=1)
    tracks = [track]
    tracked(tracks, points_on(patch(0.1, 0.0, 3.87)), arrived(person(0.1, 4.0)))
    assert tracks == [track]
    assert track.outline is not None
    assert track.outline.seen


def test_a_body_whose_points_get_too_few_goes_on_from_where_they_left_it(
    make_track: MakeTrack,
) -> None:
    """Its origin has moved on it meanwhile, so its segment's place on it is another one."""
    track = make_track((0.1, 0.0, 3.9), number=1)
    tracks, points = [track], points_on(patch(0.1, 0.0, 3.87))
    scene = arrived(person(0.1, 4.0))
    tracked(tracks, points, scene)
    track.rigid = track.by_points = True
    track.outline.offsets.clear()
    tracked(tracks, points, scene)
    place, loose = track.mean[POSITION] + [0.1, 0.0, 0.0], np.eye(3) * 0.3**2
    track.filter = BodyFilter.begin(place, track.mean[VELOCITY], loose, loose, 0.0)
    tracked(tracks, points, scene)
    track.rigid = track.by_points = False
    tracked(tracks, points, scene)
    assert track.mean[POSITION] == pytest.approx(place, abs=0.02)


def test_a_segment_containing_points_of_two_bodies_merges_them(
    make_track: MakeTrack,
) -> None:
    sure, part = make_track((0.1, -0.3, 3.9), number=1), make_track((0.1, 0.3, 3.9), number=2)
    sure.state = TrackState.CONFIRMED
    tracks = [part, sure]
    points = points_on(patch(0.1, -0.3, 3.87), patch(0.1, 0.3, 3.87))
    points = tracked(tracks, points, arrived(person(0.1, 4.0)))
    assert tracks == [sure]
    assert set(points.obstacle) == {1, NO_OBSTACLE}


@pytest.mark.parametrize(("z", "same"), [(3.3, True), (6.0, False)])
def test_points_of_a_vanished_body_do_not_claim_a_segment_far_behind_it(
    z: float, same: bool
) -> None:
    tracks, host = outlined(person(0.1, 3.0), TrackIds())
    host.id, host.state = 1, TrackState.CONFIRMED
    # The person is gone, and some of the points around lie on what was hidden before.
    tracked(tracks, points_on(patch(0.1, 0.0, z - 0.13)), arrived(person(0.1, z)))
    assert host.outline is not None
    assert host.outline.seen is same
    assert (len(tracks) == 1) is same


@pytest.mark.parametrize(("aside", "same"), [(0.3, True), (1.9, False)])
def test_a_body_is_not_matched_to_a_side_far_from_it(aside: float, same: bool) -> None:
    """Even though the offset of a side seen for the first time is unknown."""
    tracks, host = outlined(person(0.0, 4.0), TrackIds())
    assert host.outline is not None
    shift = np.array([aside, 0.0, 0.0])
    place = host.mean[POSITION] + shift
    host.outline.move_origin(shift)
    host.filter = BodyFilter.begin(place, np.zeros(3), np.eye(3) * 0.1**2, np.eye(3), 0.0)
    tracked(tracks, TrackedPoints.none(), arrived(person(0.0, 4.0)))
    assert host.outline.seen is same
    np.testing.assert_allclose(host.mean[POSITION], place, atol=1e-9)


@pytest.mark.parametrize("seen_before", [True, False])
def test_a_body_out_of_sight_is_found_only_at_a_separate_segment(
    seen_before: bool,
) -> None:
    """A part of a wall at the expected place does not count as the body."""
    tracks, host = outlined(person(0.0, 4.0), TrackIds())
    assert host.outline is not None
    host.missed_s = DT if seen_before else 4 * DT
    wall = seen([*ROOM, Solid((0.0, 0.0, 4.0), (6.0, 2.4, 0.1))])
    tracked(tracks, TrackedPoints.none(), wall)
    assert host.outline.seen is seen_before
    host.missed_s = 4 * DT
    tracked(tracks, TrackedPoints.none(), arrived(person(0.0, 4.0)))
    assert host.outline.seen


def test_a_fragment_on_the_outline_of_another_body_is_absorbed(make_track: MakeTrack) -> None:
    newcomer = person(0.1, 4.0)
    tracks, host = outlined(newcomer, TrackIds())
    host.id, host.state = 7, TrackState.CONFIRMED
    part = make_track((0.1, 0.3, 3.9), number=1)
    tracks.append(part)
    points = tracked(tracks, points_on(patch(0.1, 0.3, 3.87)), arrived(newcomer))
    assert tracks == [host]
    assert host.id == 7
    assert (points.obstacle == NO_OBSTACLE).all()
    assert (points.within == 7).all()


def test_a_reported_body_keeps_its_number_when_an_outline_absorbs_it(
    make_track: MakeTrack,
) -> None:
    newcomer, numbers = person(0.1, 4.0), TrackIds()
    tracks, host = outlined(newcomer, numbers)
    assert host.id < 0
    part = make_track((0.1, 0.3, 3.9), number=1)
    part.state = TrackState.CONFIRMED
    tracks.append(part)
    points = tracked(tracks, points_on(patch(0.1, 0.3, 3.87)), arrived(newcomer), numbers)
    assert tracks == [host]
    assert (host.id, host.state) == (1, TrackState.CONFIRMED)
    assert (points.within == 1).all()


def test_a_body_beside_an_outline_is_not_absorbed(make_track: MakeTrack) -> None:
    newcomer = person(0.1, 4.0)
    tracks, host = outlined(newcomer, TrackIds())
    beside = make_track((1.0, 0.0, 6.0), number=1)
    tracks.append(beside)
    points = tracked(tracks, points_on(patch(1.0, 0.0, 6.0)), arrived(newcomer))
    assert tracks == [host, beside]
    assert (points.obstacle == 1).all()


def test_time_merged_with_the_surroundings_is_counted(make_track: MakeTrack) -> None:
    """Points move on a wall, from which no segment stands apart."""
    track = make_track((0.5, -0.2, 4.0), number=1)
    track.points = 9
    for k in range(3):
        tracked([track], points_on(patch(0.5, -0.2, 4.0)), seen([*ROOM, NEAR_WALL]))
        assert track.merged_s == pytest.approx((k + 1) * DT)
    assert not track.far
    assert track.outline is None


@pytest.mark.parametrize("crosses", [True, False])
def test_a_head_crossing_the_view_becomes_a_whole_person(
    make_track: MakeTrack, crosses: bool
) -> None:
    """In plain clothes that show no motion, in front of a ceiling without depth."""
    newcomer = person(0.1, 4.0)
    scene = seen([*ROOM, newcomer], evidence=np.full(GRID.shape, STATIC, np.uint8))
    rows = np.arange(GRID.height)[:, None] < GRID.height / 2
    ceiling = rows & ~cells_of(newcomer, [*ROOM, newcomer])
    scene = replace(scene, disparity=np.where(ceiling, np.nan, scene.disparity))
    head = patch(0.1, -0.4, 3.87)
    track = make_track((0.1, -0.4, 3.9), (0.6, 0.0, 0.0), number=1)
    track.points, track.crosses = 9, crosses
    tracked([track], points_on(head), scene)
    assert (track.outline is not None) is crosses
    if track.outline is not None:
        assert track.outline.height == pytest.approx(1.6, abs=0.15)
        assert track.part_moves, "the trunk shows whether the person walks"
        np.testing.assert_array_equal(track.mean[VELOCITY], 0.0)


def test_a_body_beyond_segment_range_does_not_count_as_merged(
    make_track: MakeTrack,
) -> None:
    track = make_track((0.5, -0.2, 7.9), number=1)
    track.points, track.merged_s = 9, 0.1
    for blind in (False, True):
        scene = seen(ROOM)
        if blind:
            scene = replace(scene, disparity=np.full_like(scene.disparity, np.nan))
        tracked([track], points_on(patch(0.5, -0.2, 7.99)), scene)
        assert track.far
        assert track.merged_s == 0.1
    tracked([track], points_on(patch(0.5, -0.2, 4.0)), seen([*ROOM, NEAR_WALL]))
    assert not track.far


def test_a_body_that_lost_its_outline_counts_as_merged(make_track: MakeTrack) -> None:
    """No cell stands out from its surroundings any more; its points are still tracked."""
    tracks, host = outlined(person(0.5, 4.0), TrackIds())
    host.filter = make_track((0.5, -0.2, 4.0), number=host.id).filter
    points = points_on(patch(0.5, -0.2, 4.0))
    scene = seen([*ROOM, NEAR_WALL])
    scene = replace(scene, standing=np.zeros_like(scene.standing))
    points = points.but(obstacle=np.full(len(points), host.id))
    for _ in range(3):
        points = tracked(tracks, points, scene)
    assert host.outline is not None
    assert not host.outline.seen
    assert host.merged_s == pytest.approx(3 * DT)


def test_members_known_to_be_on_the_floor_lie(make_track: MakeTrack) -> None:
    """However low, what is higher stands."""
    scene = seen([*ROOM, NEAR_WALL])
    assert scene.ground is not None
    for height_m, mounted, lies in ((0.0, True, True), (0.2, True, False), (0.0, False, False)):
        place = (0.5, HEIGHT_M - height_m, 3.0)
        track = make_track(place, number=1)
        track.points = 9
        ground = replace(scene.ground, mounted=mounted)
        tracked([track], points_on(patch(*place)), replace(scene, ground=ground))
        assert track.lies is lies


def test_members_on_the_floor_are_not_off_the_ground(make_track: MakeTrack) -> None:
    for place, off_ground in (((0.5, -0.2, 4.0), True), ((0.5, 0.9, 3.0), False)):
        track = make_track(place, number=1)
        track.points = 9
        tracked([track], points_on(patch(*place)), seen([*ROOM, NEAR_WALL]))
        assert track.merged_s > 0
        assert track.off_ground is off_ground


def test_a_body_reappearing_from_occlusion_keeps_its_number(make_track: MakeTrack) -> None:
    newcomer = person(0.3, 4.0)
    for z, same in ((4.1, True), (6.5, False)):
        track = make_track((0.3, 0.2, z), (0.0, 0.0, 0.0), number=1, sigma=0.1)
        track.state, track.missed_s = TrackState.COASTING, 0.6
        tracks = [track]
        tracked(tracks, TrackedPoints.none(), arrived(newcomer))
        assert (len(tracks) == 1) is same
        assert (track.missed_s == 0.0) is same


def test_the_likelier_of_two_hidden_bodies_returns_and_the_other_remains(
    make_track: MakeTrack,
) -> None:
    """However long each was out of sight, and even if a few points still show one of them."""
    for missed_s in ((0.6, 0.6), (0.6, 0.0)):
        far = make_track((0.9, 0.2, 4.1), (0.0, 0.0, 0.0), number=1, sigma=0.2)
        near = make_track((0.4, 0.2, 4.1), (0.0, 0.0, 0.0), number=2, sigma=0.2)
        tracks = [far, near]
        for track, missed in zip(tracks, missed_s, strict=True):
            track.state, track.missed_s, track.rigid = TrackState.COASTING, missed, False
        tracked(tracks, TrackedPoints.none(), arrived(person(0.3, 4.0)))
        assert tracks == [far, near]
        assert far.outline is None
        assert near.outline is not None


@pytest.mark.parametrize(("z", "same"), [(4.2, True), (7.5, False)])
def test_a_body_that_left_the_image_and_turned_keeps_its_number(
    make_track: MakeTrack, z: float, same: bool
) -> None:
    """Even though it was expected to go straight on."""
    edge = 4.0 * (CAMERA.width / 2) / CAMERA.fx
    newcomer = person(edge - 0.4, 4.0)
    track = make_track((edge + 1.2, 0.2, z), (1.0, 0.0, 0.0), number=1, sigma=0.1)
    track.state, track.missed_s, track.rigid = TrackState.COASTING, 1.2, False
    tracks = [track]
    tracked(tracks, TrackedPoints.none(), arrived(newcomer))
    assert (len(tracks) == 1) is same
    if same:
        assert np.linalg.norm(track.mean[VELOCITY]) < 0.1, "the way that it went is over"


def test_a_body_stays_visible_between_frames_with_depth() -> None:
    newcomer = person(0.1, 4.0)
    tracks, host = outlined(newcomer, TrackIds())
    host.filter = host.filter.with_velocity(np.array([0.9, 0.0, 0.0]), np.eye(3) * 1e-6)
    before = host.outline.box_px
    points = points_on(patch(0.15, 0.0, 3.87, side=0.1))
    for _ in range(2):
        host.filter = host.filter.predicted(DT, (0.1, 0.1), (0.0, 0.0), None)
        host.missed_s += DT
        points = without_segments(tracks, points, now_at())
        assert host.outline.seen
        assert host.missed_s == 0.0
        assert (points.within == host.id).all()
    went_px = 2 * DT * 0.9 * CAMERA.fx / 4.0
    assert host.outline.box_px[0] - before[0] == pytest.approx(went_px, abs=2 * GRID.reduction)


def test_outlines_expire_after_a_long_time_without_depth() -> None:
    newcomer = person(0.1, 4.0)
    tracks, host = outlined(newcomer, TrackIds())
    points = points_on(patch(0.1, 0.0, 3.87)).but(within=np.full(9, host.id))
    for _ in range(6):
        host.missed_s += DT
        points = without_segments(tracks, points, now_at())
    assert not host.outline.seen
    assert host.missed_s > 0
    assert (points.within == NO_OBSTACLE).all()
    assert (points.obstacle == 1).all()
