"""The life of obstacles, for bodies made of known points whose places are seen with known noise."""

from __future__ import annotations

from dataclasses import replace
from itertools import count
from typing import Any

import numpy as np
import pytest

from observer.camera import StereoCamera
from observer.geometry import Pose
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.expectation import expected_at, note_lasting_errors
from observer.methods.rigid.bodies.filter import POSITION, VELOCITY
from observer.methods.rigid.bodies.shape import Box
from observer.methods.rigid.bodies.tracker import BodyTracker
from observer.methods.rigid.camera_step import CameraStep
from observer.methods.rigid.motion_test import pooled_motion
from observer.methods.rigid.position_velocity_filter import PositionVelocityFilter
from observer.methods.rigid.tracked_points import NO_OBSTACLE, TrackedPoints
from observer.parameters import EvidenceParameters, Parameters
from observer.types import MotionState, TrackState
from observer.vision.camera_rate import CameraRate

from .... import builders
from ..solid_worlds import outline_of, person

P = Parameters()
DT = 1 / 15
SIZE = (0.4, 0.3, 0.5)
CAMERA = StereoCamera(512, 256, 443.0, 443.0, 255.5, 127.5, 0.12)


@pytest.fixture
def box(planted: Any, points_on_a_box: Any) -> Any:
    """Gives a box-shaped body of 60 points that moves as told."""

    def make(pose: Any, seed: int = 0, per_face: int = 15, **kinds: Any) -> Any:
        rng = np.random.default_rng(seed)
        local, normals = points_on_a_box(rng, kinds.pop("size", SIZE), per_face)
        return planted(local, pose, normals, **kinds)

    return make


@pytest.fixture
def crate(box: Any) -> Any:
    """One that stands."""
    return box(lambda _: ((0.9, 0.0, 3.5), 0.4), seed=9)


def to_the_right(speed: float = 0.4, x: float = -0.6, z: float = 3.0) -> Any:
    return lambda t: ((x + speed * t, 0.0, z), 0.3)


def seen_from(rate: CameraRate) -> CameraStep:
    """The world's origin, reached at this rate."""
    return CameraStep(CAMERA, Pose.identity(), np.zeros((6, 6)), rate, DT)


def errors(stretch: float) -> EvidenceParameters:
    """Lasting errors of distortion alone."""
    return P.evidence.model_copy(update={"disparity_bias_px": 0.0, "distortion_sigma": stretch})


def alive(tracks: list[BodyTrack]) -> list[BodyTrack]:
    return [t for t in tracks if t.state is not TrackState.TENTATIVE]


def test_a_body_is_confirmed_once_it_surely_moves(watched: Any, box: Any, crate: Any) -> None:
    run = watched(box(to_the_right()), crate)
    states = []
    for _ in range(12):
        tracks = run.step()
        states.append(tracks[0].state if tracks else None)
    assert states[0] is None
    tentative = states.index(TrackState.TENTATIVE)
    confirmed = states.index(TrackState.CONFIRMED)
    # Three frames and no fewer, by parameter; half a second at most.
    assert tentative < confirmed <= 8
    assert confirmed - tentative >= 2
    assert set(states[confirmed:]) == {TrackState.CONFIRMED}
    (track,) = run.tracks
    assert track.motion is MotionState.MOVING
    assert track.significance > 5


@pytest.mark.parametrize(("members", "frames"), [(3, 16), (4, 8), (10, 3), (60, 3)])
def test_the_fewer_points_the_longer_they_must_move_alike(
    make_track: Any, members: int, frames: int
) -> None:
    track, tracker = make_track(), BodyTracker()
    track.points, tracker.tracks = members, [track]
    states = []
    for _ in range(20):
        tracker.update_lifecycle(
            TrackedPoints.none(), np.zeros(3), lambda _: 0.1, DT, Parameters().obstacles
        )
        states.append(track.state)
    assert track.significance > Parameters().obstacles.confirm_sigmas
    assert states.index(TrackState.CONFIRMED) == frames - 1


def test_its_number_is_provisional_until_it_is_confirmed_and_then_lasts(
    watched: Any, box: Any, crate: Any
) -> None:
    run = watched(box(to_the_right()), crate)
    run.tracker = BodyTracker(count(7))
    seen = []
    for _ in range(25):
        seen += [(t.state is TrackState.TENTATIVE, t.id) for t in run.step()]
        # Its points go by the same number.
        for track in run.tracks:
            assert np.count_nonzero(run.points.obstacle == track.id) == track.points or not (
                track.points
            )
        known = {t.id for t in run.tracks} | {NO_OBSTACLE}
        assert set(run.points.obstacle.tolist()) <= known
    assert all(number < NO_OBSTACLE for tentative, number in seen if tentative)
    assert {number for tentative, number in seen if not tentative} == {7}
    assert sum(not tentative for tentative, _ in seen) > 15


def test_who_is_confirmed_keeps_its_number_when_it_is_one_with_an_older_one(
    make_track: Any,
) -> None:
    older, younger = make_track(number=-2), make_track(number=4)
    younger.state = TrackState.CONFIRMED
    tracker = BodyTracker(count(9))
    tracker.tracks = [older, younger]
    points = tracker.update_lifecycle(
        TrackedPoints.none(), np.zeros(3), lambda _: 0.1, 1 / 15, Parameters().obstacles
    )
    assert len(points) == 0
    assert [(t.id, t.state) for t in tracker.tracks] == [(4, TrackState.CONFIRMED)]
    assert tracker.tracks[0] is older


def test_its_velocity_and_centre_are_those_of_the_body(watched: Any, box: Any, crate: Any) -> None:
    body = box(to_the_right())
    run = watched(body, crate)
    run.run(1.5)
    squared = []
    for _ in range(20):
        (track,) = alive(run.step())
        velocity, cov = track.centre_velocity()
        gap = velocity - [0.4, 0, 0]
        squared.append(gap @ np.linalg.solve(cov, gap))
        assert np.linalg.norm(gap) < 0.04
        centre = np.asarray(body.pose(run.time)[0])
        assert np.linalg.norm((track.centre - centre)[[0, 2]]) < 0.12
    assert np.mean(squared) < 7.8
    # Every point of the body is a member and none of the crate.
    mine = run.points.obstacle == track.id
    assert mine[run.owner == 0].mean() > 0.9
    assert not mine[run.owner == 1].any()


def test_its_velocity_is_known_no_better_than_the_calibration(make_track: Any) -> None:
    """At the edge of the view a camera that drives does not know how fast things pass."""
    rate = CameraRate(np.zeros(3), np.array([0.0, 0.0, -1.0]))
    tracker, track = BodyTracker(), make_track()
    tracker.tracks = [track]
    edge = CAMERA.triangulate(np.array([[5.0, CAMERA.cy]]), np.array([12.0]))[0]
    doubt = {}
    for stretch in (0.0, 0.05):
        track.filter.means[:, POSITION] = edge
        track.filter = replace(track.filter)
        note_lasting_errors(tracker.tracks, seen_from(rate), errors(stretch))
        doubt[stretch] = track.lasting_cov
    own = track.mean[None, VELOCITY]
    drift = 0.05 * rate.velocity_by_distortion(edge[None], own, CAMERA)[0]
    np.testing.assert_allclose(doubt[0.05], np.outer(drift, drift))
    assert np.sqrt(doubt[0.05][0, 0]) > 0.005
    assert not doubt[0.0].any()
    track.missed_s = 0.1
    note_lasting_errors(tracker.tracks, seen_from(CameraRate.still()), errors(0.05))
    np.testing.assert_array_equal(track.lasting_cov, doubt[0.05])


@pytest.mark.parametrize(("speed", "begins"), [(0.02, False), (0.1, True)])
def test_what_creeps_begins_no_track(speed: float, begins: bool) -> None:
    """However surely: points slide along the edge of one thing before another."""
    rng = np.random.default_rng(1)
    place = rng.uniform((-0.2, -0.2, 2.9), (0.2, 0.2, 3.1), (20, 3))
    points = builders.watched(CAMERA, place, np.array([speed, 0, 0]), rng, sigma_px=0.002)
    motion = pooled_motion(points, seen_from(CameraRate.still()), P.evidence)
    assert motion.dynamic.all()
    tracker = BodyTracker()
    tracker.spawn(points, motion, lambda _: 0.2, P.obstacles)
    assert bool(tracker.tracks) == begins


def test_what_stands_is_no_obstacle(watched: Any, crate: Any) -> None:
    run = watched(crate, seed=1)
    for _ in range(60):
        assert not alive(run.step())


def test_a_turning_body_is_known_to_turn(watched: Any, box: Any, crate: Any) -> None:
    rate, radius = 0.5, 0.6

    def circle(t: float) -> Any:
        angle = rate * t
        return (
            (radius * (1 - np.cos(angle)) - 0.3, 0.0, 2.6 + radius * np.sin(angle)),
            angle,
        )

    run = watched(box(circle), crate)
    run.run(2.0)
    for _ in range(15):
        (track,) = alive(run.step())
        sigma = float(np.sqrt(track.filter.covariance[7, 7]))
        assert abs(track.yaw_rate - rate) < max(4 * sigma, 0.1)
        angle = rate * run.time
        expected = rate * radius * np.array([np.sin(angle), 0, np.cos(angle)])
        velocity, _ = track.centre_velocity()
        assert np.linalg.norm(velocity - expected) < 0.06
    assert track.yaw_rate > 0.3


@pytest.mark.parametrize("hidden_s", [0.4, 1.0])
def test_a_hidden_body_coasts_along_its_way_and_returns_as_itself(
    hidden_s: float, watched: Any, box: Any, crate: Any
) -> None:
    begin = 1.6
    body = box(to_the_right(x=-0.9), seen=lambda t: not -1e-6 <= t - begin < hidden_s - 1e-6)
    run = watched(body, crate)
    run.run(begin - DT)
    (before,) = alive(run.tracks)
    number = before.id
    assert before.state is TrackState.CONFIRMED
    for _ in range(round(hidden_s / DT) - 1):
        (track,) = alive(run.step())
        assert track.id == number
        assert track.state is TrackState.COASTING
        truth = np.asarray(body.pose(run.time)[0])
        assert np.linalg.norm((track.centre - truth)[[0, 2]]) < 0.15
    assert track.missed_s == pytest.approx(hidden_s - DT, abs=1.5 * DT)
    for _ in range(10):
        tracks = run.step()
    (track,) = alive(tracks)
    assert track.id == number
    assert track.state is TrackState.CONFIRMED
    assert track.missed_s == 0
    velocity, _ = track.centre_velocity()
    assert np.linalg.norm(velocity - [0.4, 0, 0]) < 0.06


def test_a_body_that_does_not_return_ends(watched: Any, box: Any, crate: Any) -> None:
    run = watched(box(to_the_right(), seen=lambda t: t < 1.5), crate, coast_s=0.5)
    run.run(1.5 - DT)
    (before,) = alive(run.tracks)
    states = [[t.state for t in run.step()] for _ in range(12)]
    assert before.id not in run.points.obstacle
    coasting = sum(s == [TrackState.COASTING] for s in states)
    assert 0.5 / DT - 2 <= coasting <= 0.5 / DT + 2
    assert states[-1] == []


def test_what_comes_after_the_end_has_another_number(watched: Any, box: Any, crate: Any) -> None:
    run = watched(box(to_the_right(x=-0.9), seen=lambda t: not 1.5 <= t < 2.5), crate, coast_s=0.3)
    run.run(1.5 - DT)
    (before,) = alive(run.tracks)
    run.run(2.0)
    (after,) = alive(run.tracks)
    assert after.id > before.id


def test_one_that_stops_stays_known_as_stopped_and_drives_on_as_itself(
    watched: Any, box: Any, crate: Any
) -> None:
    def stop_and_go(t: float) -> Any:
        driven = min(t, 1.5) + max(0.0, t - 4.0)
        return ((-0.6 + 0.4 * driven, 0.0, 3.0), 0.3)

    run = watched(box(stop_and_go), crate)
    run.run(1.5)
    (track,) = alive(run.tracks)
    number = track.id
    assert track.motion is MotionState.MOVING
    run.run(0.8)
    while run.time < 4.0 - DT:
        (track,) = alive(run.step())
        assert track.id == number
        assert track.state is TrackState.CONFIRMED
        assert track.motion is MotionState.STOPPED
        assert np.linalg.norm(track.centre_velocity()[0]) < 0.06
    run.run(0.8)
    (track,) = alive(run.tracks)
    assert track.id == number
    assert track.motion is MotionState.MOVING
    assert np.linalg.norm(track.centre_velocity()[0] - [0.4, 0, 0]) < 0.05


def test_two_that_cross_keep_their_numbers(watched: Any, box: Any) -> None:
    """The nearer one hides the farther one for a good half second."""

    def apart(t: float) -> float:
        return abs((-0.7 + 0.4 * t) / 2.4 - (0.9 - 0.4 * t) / 3.4)

    near = box(to_the_right(x=-0.7, z=2.4), seed=1)
    far = box(lambda t: ((0.9 - 0.4 * t, 0.0, 3.4), -0.3), seed=2, seen=lambda t: apart(t) > 0.08)
    run = watched(near, far)
    numbers = set()
    hidden = 0
    for k in range(58):
        tracks = alive(run.step())
        hidden += not far.seen(run.time)
        if k < 15:
            continue
        velocities = {t.id: float(t.centre_velocity()[0][0]) for t in tracks}
        assert len(velocities) == 2
        numbers.add(tuple(sorted((number, v > 0) for number, v in velocities.items())))
        for track in tracks:
            body = near if velocities[track.id] > 0 else far
            truth = np.asarray(body.pose(run.time)[0])
            assert np.linalg.norm((track.centre - truth)[[0, 2]]) < 0.2
    assert hidden >= 6
    assert len(numbers) == 1


def test_a_body_found_in_two_parts_becomes_one(watched: Any, planted: Any) -> None:
    """Its ends are seen first, too far apart to be neighbours; then its middle."""
    rng = np.random.default_rng(3)
    local = rng.uniform(-0.5, 0.5, (90, 3)) * [1.1, 0.3, 0.1]
    ends = np.abs(local[:, 0]) > 0.4
    middle_from = 1.2

    class Revealed(planted):  # type: ignore[misc]
        def shown(self, time: float) -> np.ndarray:
            return ends | (time >= middle_from)

    run = watched(Revealed(local, to_the_right(0.3, -0.4, 2.4)))
    run.run(middle_from - DT)
    assert len(alive(run.tracks)) == 2
    oldest = min(t.id for t in run.tracks)
    run.run(1.0)
    (track,) = alive(run.tracks)
    assert track.id == oldest
    assert (run.points.obstacle == oldest).mean() > 0.9
    assert track.box is not None
    assert track.box.size.max() > 0.85


@pytest.mark.parametrize(
    ("rigid", "seen", "joined"), [(True, False, True), (False, True, True), (False, False, False)]
)
def test_points_in_the_place_of_somebody_out_of_sight_do_not_show_him(
    make_track: Any, rigid: bool, seen: bool, joined: bool
) -> None:
    """His shadow would do for that. Points of a rigid body are that body."""
    whole = Box(np.zeros(3), np.array([0.5, 1.7, 0.3]), 0.0)
    older, part = make_track(box=whole), make_track((0.1, 0.1, 3.0), number=2)
    older.outline = outline_of(person(0.0, 3.0))
    older.outline.seen, older.rigid = seen, rigid
    older.outline.middle = older.centre
    tracker = BodyTracker(count(9))
    tracker.tracks = [older, part]
    places = np.array([[0.1, 0.1, 3.0], [0.12, 0.1, 3.0]])
    sums = PositionVelocityFilter.begin(places, np.tile(np.eye(3) * 1e4, (2, 1, 1)))
    px = np.zeros((2, 2), np.float32)
    points = TrackedPoints.begin(0, px, px, np.full(2, np.nan), sums)
    points = tracker.update_lifecycle(
        points.but(obstacle=np.full(2, 2)), np.zeros(3), lambda _: 0.1, DT, Parameters().obstacles
    )
    assert tracker.tracks == [older]
    assert set(points.obstacle) == {1 if joined else NO_OBSTACLE}


def test_a_duplicate_is_merged_into_the_older(watched: Any, box: Any, crate: Any) -> None:
    run = watched(box(to_the_right()), crate)
    run.run(1.5)
    (track,) = alive(run.tracks)
    double = BodyTrack(
        id=99, filter=track.filter, shape=track.shape, state=TrackState.CONFIRMED, box=track.box
    )
    half = np.flatnonzero(run.points.obstacle == track.id)[::2]
    obstacle = run.points.obstacle.copy()
    obstacle[half] = 99
    run.points = run.points.but(obstacle=obstacle)
    run.tracker.tracks.append(double)
    (left,) = alive(run.step())
    assert left.id == track.id
    assert 99 not in run.points.obstacle
    assert left.points < (run.points.obstacle == track.id).sum()


def test_a_point_that_leaves_its_body_is_given_back(watched: Any, box: Any, crate: Any) -> None:
    """What slid off onto the background does not move with the body any more."""
    body = box(to_the_right())
    left_behind = np.arange(0, 60, 10)
    drive = body.places

    def places(time: float) -> np.ndarray:
        at = drive(time)
        at[left_behind] = drive(min(time, 1.5))[left_behind]
        return at

    body.places = places
    run = watched(body, crate)
    run.run(2.5)
    (track,) = alive(run.tracks)
    strangers = (run.owner == 0) & np.isin(run.which, left_behind)
    assert strangers.any()
    assert not (run.points.obstacle[strangers] == track.id).any()
    others = (run.owner == 0) & ~strangers
    assert (run.points.obstacle[others] == track.id).mean() > 0.9
    assert np.linalg.norm(track.centre_velocity()[0] - [0.4, 0, 0]) < 0.04


def test_uneven_frames_make_no_difference(watched: Any, box: Any, crate: Any) -> None:
    run = watched(box(to_the_right()), crate)
    rng = np.random.default_rng(4)
    while run.time < 2.5:
        run.step(float(rng.choice([DT, DT, 2 * DT, 3 * DT, 0.5 * DT])))
    (track,) = alive(run.tracks)
    assert np.linalg.norm(track.centre_velocity()[0] - [0.4, 0, 0]) < 0.04
    assert track.age_s == pytest.approx(run.time, abs=0.4)


def test_its_points_are_expected_where_it_will_be(watched: Any, box: Any, crate: Any) -> None:
    body = box(to_the_right())
    run = watched(body, crate)
    run.run(1.5)
    place, _ = run.points.sums.static_position()
    dt = 0.3
    expected = expected_at(run.tracker.tracks, run.points, place, dt, run.parameters.obstacles)
    mine = (run.owner == 0) & (run.points.obstacle != -1)
    truth = body.places(run.time + dt)[run.which[mine]]
    assert np.median(np.linalg.norm((expected[mine] - truth)[:, [0, 2]], axis=1)) < 0.04
    # Who does not move is expected to stay: nothing is said of it.
    assert np.isnan(expected[run.owner == 1]).all()


def test_its_box_in_the_image_holds_its_points(watched: Any, box: Any, crate: Any) -> None:
    run = watched(box(to_the_right()), crate)
    run.run(1.5)
    (track,) = alive(run.tracks)
    mine = run.points.px[run.points.obstacle == track.id]
    u0, v0, u1, v1 = track.box_px
    assert (u0, v0) == pytest.approx(tuple(mine.min(axis=0)), abs=3)
    assert (u1, v1) == pytest.approx(tuple(mine.max(axis=0)), abs=3)
    (around,) = run.tracker.boxes_px(Pose.identity(), CAMERA)
    inside = (mine >= around[:2] - 6).all(axis=1) & (mine <= around[2:] + 6).all(axis=1)
    assert inside.mean() > 0.9


def test_points_of_known_obstacles_are_known(watched: Any, box: Any, crate: Any) -> None:
    run = watched(box(to_the_right()), crate)
    while not run.tracks:
        run.step()
    assert run.tracks[0].state is TrackState.TENTATIVE
    assert not run.tracker.known(run.points).any()
    run.run(1.0)
    assert run.tracker.known(run.points).tolist() == (run.points.obstacle != -1).tolist()
    assert run.tracker.known(run.points).any()


def test_numbers_go_on_in_the_next_segment(watched: Any, box: Any, crate: Any) -> None:
    run, numbers = watched(box(to_the_right(x=-1.0)), crate), count(1)
    run.tracker = BodyTracker(numbers)
    run.run(1.0)
    (first,) = alive(run.tracks)
    run.tracker = BodyTracker(numbers)
    run.points = run.points.but(obstacle=np.full(len(run.points), -1))
    assert run.tracks == []
    run.run(0.6)
    (second,) = alive(run.tracks)
    assert second.id > first.id


def test_numbers_may_be_given(watched: Any, box: Any, crate: Any) -> None:
    """By whoever keeps them over segments."""
    run = watched(box(to_the_right()), crate)
    run.tracker = BodyTracker(count(40))
    run.run(1.0)
    assert {t.id for t in run.tracks} == {40}


@pytest.mark.parametrize(("name", "value"), [("confirm_sigmas", 50.0), ("confirm_hits", 12)])
def test_the_parameters_say_when_it_is_confirmed(
    name: str, value: float, watched: Any, box: Any, crate: Any
) -> None:
    usual, strict = (
        watched(box(to_the_right(0.25)), crate, **kinds) for kinds in ({}, {name: value})
    )
    assert alive(usual.run(0.6))
    assert not alive(strict.run(0.6))
