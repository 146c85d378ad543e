"""Bodies that are tracked by their segments, in worlds of boxes that move as told."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from observer.geometry import Float64Array, Pose
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import POSITION, VELOCITY, YAW_RATE, BodyFilter
from observer.methods.rigid.bodies.segment_tracking import (
    learn_box,
    measure_limbs,
    track_segments,
    without_segments,
)
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.motion_test import pooled_motion
from observer.methods.rigid.tracked_points import NO_OBSTACLE, TrackedPoints, WorldSightings
from observer.parameters import Parameters
from observer.types import MotionState, TrackState
from observer.vision.lifecycle import TrackIds

from ..solid_worlds import (
    CAMERA,
    DT,
    GRID,
    ROOM,
    Shape,
    Solid,
    SolidView,
    arrived,
    on_floor,
    patch,
    person,
    points_on,
    seen,
)
from ..solid_worlds import step_to as now_at

MakeTrack = Callable[..., BodyTrack]
MIN_POINTS = Parameters().obstacles.min_points
NEAR_WALL = Solid((0.0, -0.5, 4.0), (4.0, 1.5, 0.1))


def tracked(
    tracks: list[BodyTrack],
    points: TrackedPoints,
    scene: DenseScene,
    numbers: TrackIds | None = None,
) -> TrackedPoints:
    return track_segments(tracks, points, scene, now_at(), numbers or TrackIds(), MIN_POINTS)


def walk(
    view: SolidView,
    path: Callable[[float], tuple[float, float]],
    frames: int,
    *others: Shape,
    poses: Callable[[float], Pose] = lambda _: Pose.identity(),
) -> list[tuple[float, float]]:
    """A person walks x, z metres at a time since now; returns where it was in each frame."""
    begun = view.time
    way = []
    for _ in range(frames):
        since = view.time + DT - begun
        way.append(path(since))
        view.step([*ROOM, *others, person(*way[-1])], poses(since))
    return way


def watching(*others: Shape) -> SolidView:
    """A view that has seen a room without anybody for some time."""
    view = SolidView()
    for _ in range(5):
        view.step([*ROOM, *others])
    assert view.tracks == []
    return view


def confirmed(view: SolidView) -> BodyTrack:
    (track,) = [t for t in view.tracks if t.state is TrackState.CONFIRMED]
    return track


# --- who is seen by depth alone ------------------------------------------------------------


def test_who_walks_in_is_found_confirmed_and_measured_without_any_point() -> None:
    view = watching(on_floor(1.6, 5.0, (0.6, 0.8, 0.4)))
    walk(view, lambda t: (-0.8 + 0.8 * t, 4.0), 18, on_floor(1.6, 5.0, (0.6, 0.8, 0.4)))
    track = confirmed(view)
    assert track.motion is MotionState.MOVING
    assert not track.rigid
    np.testing.assert_allclose(track.centre[[0, 2]], [-0.8 + 0.8 * 1.8, 4.0], atol=0.12)
    np.testing.assert_allclose(track.centre_velocity()[0][[0, 2]], [0.8, 0.0], atol=0.15)
    assert track.box is not None
    assert track.box.size[0] == pytest.approx(0.45, abs=0.1)


def test_so_is_who_walks_towards_a_camera_that_drives() -> None:
    view = watching()

    def poses(t: float) -> Pose:
        return Pose.from_rotvec([0.0, 0.1 * t, 0.0], [0.0, 0.0, 0.3 * t])

    walk(view, lambda t: (0.2, 5.5 - 0.7 * t), 20, poses=poses)
    track = confirmed(view)
    np.testing.assert_allclose(track.centre[[0, 2]], [0.2, 5.5 - 0.7 * 2.0], atol=0.15)
    np.testing.assert_allclose(track.centre_velocity()[0][[0, 2]], [0.0, -0.7], atol=0.2)


def test_who_stands_is_never_confirmed_even_if_the_camera_drives_by() -> None:
    view = SolidView()
    for k in range(25):
        pose = Pose.from_rotvec([0.0, 0.01 * k, 0.0], [0.02 * k, 0.0, 0.04 * k])
        view.step([*ROOM, person(0.3, 4.5), on_floor(-0.9, 4.0, (0.6, 0.7, 0.5), 0.4)], pose)
        assert all(t.state is TrackState.TENTATIVE for t in view.tracks)


def test_a_stopped_body_stays_where_and_as_large_as_it_is() -> None:
    view = watching()
    walk(view, lambda t: (-0.6 + 0.8 * min(t, 1.5), 4.0), 40)
    track = confirmed(view)
    assert track.motion is MotionState.STOPPED
    np.testing.assert_allclose(track.centre[[0, 2]], [0.6, 4.0], atol=0.12)
    assert track.outline.width == pytest.approx(0.45, abs=0.1)


@pytest.mark.parametrize("side", [-1, 1])
def test_two_who_cross_keep_their_numbers(side: int) -> None:
    view = watching()
    ids: list[tuple[int, int]] = []
    for k in range(26):
        t = k * DT
        near, far = (side * (0.7 - 0.6 * t), 2.9), (side * (-1.0 + 0.8 * t), 4.6)
        view.step([*ROOM, person(*near), person(*far)])
        every = [t for t in view.tracks if t.state is not TrackState.TENTATIVE]
        if len(every) == 2:
            by_depth = sorted(every, key=lambda t: float(t.mean[2]))
            ids.append((by_depth[0].id, by_depth[1].id))
            np.testing.assert_allclose(by_depth[0].centre[[0, 2]], near, atol=0.25)
    assert len(ids) > 12
    assert len(set(ids)) == 1


# --- where it is, while it is seen in part -------------------------------------------------


def test_a_body_that_the_image_s_border_cuts_off_goes_on_smoothly() -> None:
    """Its side shows where it is: the middle of what is left to see would come to rest."""
    view = watching()
    speed, places = 0.8, []
    for k in range(25):
        x = 0.6 + speed * k * DT
        view.step([*ROOM, person(x, 4.0)])
        if k > 8 and x < 2.5:
            places.append((x, float(confirmed(view).mean[0]), confirmed(view).outline.segment.cut))
    true, found = np.array([p[0] for p in places]), np.array([p[1] for p in places])
    cut = np.array([p[2][1] for p in places])
    assert cut.any()
    assert not cut.all()
    steps = np.diff(found - true)
    assert np.abs(steps).max() < 0.06
    assert np.ptp(found - true) < 0.12


def test_the_offset_of_another_anchor_is_learned_when_it_is_first_used(
    make_track: MakeTrack,
) -> None:
    """So a body does not jump when it is measured by its side from now on."""
    guest = person(0.1, 4.0)
    track = make_track((0.1, 0.2, 3.875), (0.0, 0.0, 0.0))
    track.loosen()
    tracked([track], points_on(patch(0.1, 0.0, 3.87)), arrived(guest))
    assert set(track.outline.offsets) == {"middle"}
    before = track.mean[POSITION].copy()
    pillar = on_floor(0.18, 2.4, (0.3, 2.4, 0.1))
    tracked([track], TrackedPoints.none(), arrived(guest, pillar))
    assert track.outline.seen
    assert set(track.outline.offsets) == {"middle", "left"}
    np.testing.assert_allclose(track.mean[POSITION], before, atol=0.02)
    across = track.outline.offsets["left"][0] - track.outline.offsets["middle"][0]
    assert across == pytest.approx(-0.225, abs=0.05)


# --- points --------------------------------------------------------------------------------


def test_points_on_an_outline_know_whose_it_is() -> None:
    tracks: list[BodyTrack] = []
    on, beside = patch(0.1, 0.0, 3.87), patch(1.0, 0.0, 7.9)
    points = points_on(on, beside).but(obstacle=np.full(18, NO_OBSTACLE))
    points = tracked(tracks, points, arrived(person(0.1, 4.0)))
    (track,) = tracks
    assert points.within.tolist() == [track.id] * 9 + [NO_OBSTACLE] * 9


def test_a_segment_with_a_body_s_points_on_it_is_that_body(make_track: MakeTrack) -> None:
    track = make_track((0.1, 0.0, 3.9), number=1)
    tracks = [track]
    tracked(tracks, points_on(patch(0.1, 0.0, 3.87)), arrived(person(0.1, 4.0)))
    assert tracks == [track]
    assert track.outline is not None
    assert track.outline.seen


def test_a_segment_with_the_points_of_two_bodies_on_it_is_both_in_one(
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
def test_points_of_a_body_that_was_seen_do_not_make_something_far_behind_it(
    z: float, same: bool
) -> None:
    tracks, host = outlined(person(0.1, 3.0), TrackIds())
    host.id, host.state = 1, TrackState.CONFIRMED
    # The person is gone, and some of the points around lay on what was hidden.
    tracked(tracks, points_on(patch(0.1, 0.0, z - 0.13)), arrived(person(0.1, z)))
    assert host.outline is not None
    assert host.outline.seen is same
    assert (len(tracks) == 1) is same


@pytest.mark.parametrize(("aside", "same"), [(0.3, True), (1.9, False)])
def test_a_body_is_not_followed_by_a_side_that_is_nowhere_near_it(aside: float, same: bool) -> None:
    """Though of a side that was not seen before nobody knows how far from its middle it is."""
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
def test_whoever_was_out_of_sight_is_found_only_where_something_stands_apart(
    seen_before: bool,
) -> None:
    """A part of a wall that they covered is none, though it is where they should be."""
    tracks, host = outlined(person(0.0, 4.0), TrackIds())
    assert host.outline is not None
    host.missed_s = DT if seen_before else 4 * DT
    wall = seen([*ROOM, Solid((0.0, 0.0, 4.0), (6.0, 2.4, 0.1))])
    tracked(tracks, TrackedPoints.none(), wall)
    assert host.outline.seen is seen_before
    host.missed_s = 4 * DT
    tracked(tracks, TrackedPoints.none(), arrived(person(0.0, 4.0)))
    assert host.outline.seen


def outlined(guest: Shape, numbers: TrackIds) -> tuple[list[BodyTrack], BodyTrack]:
    tracks: list[BodyTrack] = []
    tracked(tracks, TrackedPoints.none(), arrived(guest), numbers)
    (host,) = tracks
    return tracks, host


def test_a_fragment_on_another_body_s_outline_is_absorbed(make_track: MakeTrack) -> None:
    guest = person(0.1, 4.0)
    tracks, host = outlined(guest, TrackIds())
    host.id, host.state = 7, TrackState.CONFIRMED
    part = make_track((0.1, 0.3, 3.9), number=1)
    tracks.append(part)
    points = tracked(tracks, points_on(patch(0.1, 0.3, 3.87)), arrived(guest))
    assert tracks == [host]
    assert host.id == 7
    assert (points.obstacle == NO_OBSTACLE).all()
    assert (points.within == 7).all()


def test_whoever_was_reported_keeps_its_number_when_an_outline_absorbs_it(
    make_track: MakeTrack,
) -> None:
    guest, numbers = person(0.1, 4.0), TrackIds()
    tracks, host = outlined(guest, numbers)
    assert host.id < 0
    part = make_track((0.1, 0.3, 3.9), number=1)
    part.state = TrackState.CONFIRMED
    tracks.append(part)
    points = tracked(tracks, points_on(patch(0.1, 0.3, 3.87)), arrived(guest), numbers)
    assert tracks == [host]
    assert (host.id, host.state) == (1, TrackState.CONFIRMED)
    assert (points.within == 1).all()


def test_a_body_beside_an_outline_is_not_absorbed(make_track: MakeTrack) -> None:
    guest = person(0.1, 4.0)
    tracks, host = outlined(guest, TrackIds())
    beside = make_track((1.0, 0.0, 6.0), number=1)
    tracks.append(beside)
    points = tracked(tracks, points_on(patch(1.0, 0.0, 6.0)), arrived(guest))
    assert tracks == [host, beside]
    assert (points.obstacle == 1).all()


def test_what_is_one_with_its_surroundings_is_counted_as_that(make_track: MakeTrack) -> None:
    """Points that move on a wall, of which no segment stands apart."""
    track = make_track((0.5, -0.2, 4.0), number=1)
    track.points = 9
    for k in range(3):
        tracked([track], points_on(patch(0.5, -0.2, 4.0)), seen([*ROOM, NEAR_WALL]))
        assert track.merged_s == pytest.approx((k + 1) * DT)
    assert not track.far
    assert track.outline is None


def test_what_is_farther_than_segments_is_not_one_with_its_surroundings(
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


def test_a_body_that_lost_its_outline_is_one_with_its_surroundings(make_track: MakeTrack) -> None:
    """No cell stands out of what is around it any more; its points are still followed."""
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


def test_members_on_the_floor_do_not_stand(make_track: MakeTrack) -> None:
    for place, stands in (((0.5, -0.2, 4.0), True), ((0.5, 0.9, 3.0), False)):
        track = make_track(place, number=1)
        track.points = 9
        tracked([track], points_on(patch(*place)), seen([*ROOM, NEAR_WALL]))
        assert track.merged_s > 0
        assert track.stands is stands


def test_a_body_returns_from_behind_something_as_who_it_was(make_track: MakeTrack) -> None:
    guest = person(0.3, 4.0)
    for z, same in ((4.1, True), (6.5, False)):
        track = make_track((0.3, 0.2, z), (0.0, 0.0, 0.0), number=1, sigma=0.1)
        track.state, track.missed_s = TrackState.COASTING, 0.6
        tracks = [track]
        tracked(tracks, TrackedPoints.none(), arrived(guest))
        assert (len(tracks) == 1) is same
        assert (track.missed_s == 0.0) is same


@pytest.mark.parametrize(("z", "same"), [(4.2, True), (7.5, False)])
def test_who_left_the_image_and_turned_comes_back_as_who_it_was(
    make_track: MakeTrack, z: float, same: bool
) -> None:
    """Though it went on straight as far as anybody could know."""
    edge = 4.0 * (CAMERA.width / 2) / CAMERA.fx
    guest = person(edge - 0.4, 4.0)
    track = make_track((edge + 1.2, 0.2, z), (1.0, 0.0, 0.0), number=1, sigma=0.1)
    track.state, track.missed_s, track.rigid = TrackState.COASTING, 1.2, False
    tracks = [track]
    tracked(tracks, TrackedPoints.none(), arrived(guest))
    assert (len(tracks) == 1) is same
    if same:
        assert np.linalg.norm(track.mean[VELOCITY]) < 0.1, "the way that it went is over"


def test_between_frames_with_depth_a_body_is_carried_on_as_seen() -> None:
    guest = person(0.1, 4.0)
    tracks, host = outlined(guest, TrackIds())
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


def test_without_depth_for_long_no_outline_is_seen_and_no_point_lies_on_one() -> None:
    guest = person(0.1, 4.0)
    tracks, host = outlined(guest, TrackIds())
    points = points_on(patch(0.1, 0.0, 3.87)).but(within=np.full(9, host.id))
    for _ in range(6):
        host.missed_s += DT
        points = without_segments(tracks, points, now_at())
    assert not host.outline.seen
    assert host.missed_s > 0
    assert (points.within == NO_OBSTACLE).all()
    assert (points.obstacle == 1).all()


# --- rigid bodies and bodies with limbs ----------------------------------------------------


def limbs_measured(
    track: BodyTrack,
    scene: DenseScene,
    points: TrackedPoints,
    moved: Sequence[float] = (0.0, 0.0, 0.0),
) -> TrackedPoints:
    """Points that are seen (3,) metres from where they were."""
    points = points.but(within=np.full(len(points), track.id))
    place = CAMERA.triangulate(points.px, points.disparity) + np.asarray(moved)
    sightings = WorldSightings(place, np.tile(np.eye(3) * 1e4, (len(points), 1, 1)))
    motion = pooled_motion(points, now_at(), Parameters().evidence)
    return measure_limbs([track], points, sightings, motion, scene, DT)


def many(x: float, z: float) -> Float64Array:
    return np.concatenate([patch(x, y, z, 0.15) for y in (-0.4, -0.2, 0.0, 0.2, 0.6)])


def test_points_on_a_body_with_limbs_belong_to_nobody_but_measure_its_trunk() -> None:
    guest = person(0.1, 4.0)
    tracks, host = outlined(guest, TrackIds())
    points = points_on(many(0.1, 3.87)).but(obstacle=np.full(45, host.id))
    points = limbs_measured(host, arrived(guest), points)
    assert (points.obstacle == NO_OBSTACLE).all()
    assert host.points == 45
    assert tracks == [host]
    before = host.mean[POSITION].copy()
    host.age_s += DT
    limbs_measured(host, arrived(guest), points, (0.0, 0.0, 0.04))
    np.testing.assert_allclose(host.mean[POSITION] - before, [0.0, 0.0, 0.04], atol=0.01)


def test_points_at_another_depth_are_not_on_the_body() -> None:
    guest = person(0.1, 4.0)
    _, host = outlined(guest, TrackIds())
    limbs_measured(host, arrived(guest), points_on(many(0.1, 6.0)))
    assert host.points == 0


def test_a_rigid_body_all_over_whose_outline_points_lie_stays_rigid(make_track: MakeTrack) -> None:
    """Though it stands as upright as a person."""
    guest = person(0.1, 4.0)
    track = make_track((0.1, 0.2, 3.9), (0.3, 0.0, 0.0), number=1, yaw_rate=0.3)
    _, host = outlined(guest, TrackIds())
    track.outline = host.outline
    track.points, track.box_px = 45, host.outline.box_px
    for _ in range(20):
        points = limbs_measured(track, arrived(guest), points_on(many(0.1, 3.87)))
    assert track.rigid
    assert (points.obstacle == 1).all()
    assert track.mean[YAW_RATE] == pytest.approx(0.3)


def test_the_box_of_a_body_follows_its_outline() -> None:
    _, host = outlined(person(0.1, 4.0), TrackIds())
    learn_box(host)
    np.testing.assert_allclose(host.box.size[:2], [0.45, 1.6], atol=0.15)
    np.testing.assert_allclose(host.centre[[0, 2]], [0.1, 4.0], atol=0.1)
    assert host.box_px == host.outline.box_px
    before = host.box
    host.outline.seen = False
    learn_box(host)
    assert host.box is before
