"""The life cycle of obstacles, for bodies of known points that are seen with known noise."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from observer.camera import StereoCamera
from observer.geometry import Pose
from observer.methods.rigid.bodies.expectation import expected_at, note_lasting_errors
from observer.methods.rigid.bodies.filter import POSITION, VELOCITY
from observer.methods.rigid.bodies.tracker import BodyTracker
from observer.methods.rigid.camera_step import CameraStep
from observer.methods.rigid.dense.free_space import ARRIVED
from observer.methods.rigid.dense.ground import GroundPlane
from observer.methods.rigid.motion_test import pooled_motion
from observer.methods.rigid.position_velocity_filter import PositionVelocityFilter
from observer.methods.rigid.tracked_points import TrackedPoints, WorldSightings
from observer.parameters import EvidenceParameters, Parameters
from observer.types import MotionState, TrackState
from observer.vision.camera_rate import CameraRate
from observer.vision.lifecycle import NO_OBSTACLE

from .... import builders
from ..moving_points import motion as moving
from ..solid_worlds import Solid, outline_of, points_on
from .planted_bodies import DT, SIZE, alive, to_the_right

P = Parameters()
CAMERA = StereoCamera(512, 256, 443.0, 443.0, 255.5, 127.5, 0.12)


def seen_from(rate: CameraRate) -> CameraStep:
    """A camera step that ends at the world's origin with this rate."""
    return CameraStep(CAMERA, Pose.identity(), np.zeros((6, 6)), rate, DT)


def errors(stretch: float) -> EvidenceParameters:
    """Parameters with lasting errors from distortion only."""
    return P.evidence.model_copy(update={"disparity_bias_px": 0.0, "distortion_sigma": stretch})


def test_a_body_is_confirmed_once_it_certainly_moves(watched: Any, box: Any, crate: Any) -> None:
    run = watched(box(to_the_right()), crate)
    states = []
    for _ in range(12):
        tracks = run.step()
        states.append(tracks[0].state if tracks else None)
    assert states[0] is None
    tentative = states.index(TrackState.TENTATIVE)
    confirmed = states.index(TrackState.CONFIRMED)
    # At least three frames, by parameter; at most half a second.
    assert tentative < confirmed <= 8
    assert confirmed - tentative >= 2
    assert set(states[confirmed:]) == {TrackState.CONFIRMED}
    (track,) = run.tracks
    assert track.motion is MotionState.MOVING
    assert track.significance > 5


def test_a_new_body_is_no_more_certain_than_the_calibration(
    watched: Any, box: Any, crate: Any
) -> None:
    run = watched(box(to_the_right()), crate)
    while not run.tracks:
        run.step()
    (track,) = run.tracks
    assert track.frames == 0
    assert np.linalg.eigvalsh(track.lasting_cov)[-1] > 0.0


@pytest.mark.parametrize(("members", "frames"), [(3, 16), (4, 8), (10, 3), (60, 3)])
def test_confirmation_takes_longer_with_fewer_points(
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


def test_velocity_and_centre_match_the_body(watched: Any, box: Any, crate: Any) -> None:
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
    # All points of the body are members, and none of the crate's.
    mine = run.points.obstacle == track.id
    assert mine[run.owner == 0].mean() > 0.9
    assert not mine[run.owner == 1].any()


def test_the_velocity_is_no_more_certain_than_the_calibration(make_track: Any) -> None:
    """At the edge of a driving camera's view, calibration errors make speeds uncertain."""
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
    drift = rate.lasting_errors(edge[None], own, CAMERA, 0, 0.05)[0, 1]
    np.testing.assert_allclose(doubt[0.05], np.outer(drift, drift))
    assert np.sqrt(doubt[0.05][0, 0]) > 0.005
    assert not doubt[0.0].any()
    track.missed_s = 0.1
    note_lasting_errors(tracker.tracks, seen_from(CameraRate.still()), errors(0.05))
    np.testing.assert_array_equal(track.lasting_cov, doubt[0.05])


@pytest.mark.parametrize(("speed", "begins"), [(0.02, False), (0.1, True)])
def test_very_slow_points_start_no_track(speed: float, begins: bool) -> None:
    """However certain their speed: points slide along the edge of one thing in front of another."""
    rng = np.random.default_rng(1)
    place = rng.uniform((-0.2, -0.2, 2.9), (0.2, 0.2, 3.1), (20, 3))
    points = builders.watched(CAMERA, place, np.array([speed, 0, 0]), rng, sigma_px=0.002)
    motion = pooled_motion(points, seen_from(CameraRate.still()), P.evidence)
    assert motion.dynamic.all()
    tracker = BodyTracker()
    tracker.spawn(points, motion, np.zeros(20, np.bool_), lambda _: 0.2, P.obstacles)
    assert bool(tracker.tracks) == begins


@pytest.mark.parametrize(("lying", "begins"), [(0, True), (8, True), (12, False)])
def test_points_that_mostly_lie_on_the_ground_start_no_track(lying: int, begins: bool) -> None:
    rng = np.random.default_rng(1)
    place = rng.uniform((-0.2, -0.2, 2.9), (0.2, 0.2, 3.1), (20, 3))
    points = builders.watched(CAMERA, place, np.array([0.5, 0, 0]), rng, sigma_px=0.02)
    motion = pooled_motion(points, seen_from(CameraRate.still()), P.evidence)
    tracker = BodyTracker()
    tracker.spawn(points, motion, np.arange(20) < lying, lambda _: 0.2, P.obstacles)
    assert bool(tracker.tracks) == begins


@pytest.mark.parametrize(
    ("depth_m", "mounted", "begins"), [(0.8, True, True), (0.1, True, False), (0.1, False, True)]
)
def test_what_moves_on_a_ground_known_by_the_mount_is_no_body(
    depth_m: float, mounted: bool, begins: bool
) -> None:
    """What is only seen may be a table, and the points below it those of a person beside it."""
    rng = np.random.default_rng(1)
    place = rng.uniform((-0.2, 0.2, 2.9), (0.2, 0.4, 3.1), (20, 3))
    points = builders.watched(CAMERA, place, np.array([0.5, 0, 0]), rng, sigma_px=0.02)
    now = seen_from(CameraRate.still())
    tracker = BodyTracker()
    tracker.ground = GroundPlane(np.array([0.0, 1.0, 0.0]), depth_m, mounted)
    sightings = WorldSightings(place, np.tile(np.eye(3), (20, 1, 1)))
    tracker.step(points, sightings, pooled_motion(points, now, P.evidence), None, now, P)
    assert bool(tracker.tracks) == begins


@pytest.mark.parametrize(("lies", "join"), [(False, True), (True, False)])
def test_points_on_the_ground_join_no_body_that_is_mostly_there(
    make_track: Any, lies: bool, join: bool
) -> None:
    """A reflection would spread over the whole floor."""
    track = make_track()
    track.lies = lies
    tracker = BodyTracker()
    tracker.tracks.append(track)
    places = track.mean[:3] + np.random.default_rng(0).uniform(-0.1, 0.1, (30, 3))
    seen = moving(places, track.velocity_at(places))
    points = points_on(places).but(obstacle=np.full(30, NO_OBSTACLE))
    for lying, joins in ((np.ones(30, np.bool_), join), (np.zeros(30, np.bool_), True)):
        found = tracker.associate(points, seen, lying, P.obstacles)
        assert bool((found.obstacle == track.id).mean() > 0.5) is joins


def test_a_static_crate_is_not_an_obstacle(watched: Any, crate: Any) -> None:
    run = watched(crate, seed=1)
    for _ in range(60):
        assert not alive(run.step())


def test_the_yaw_rate_of_a_turning_body_is_estimated(watched: Any, box: Any, crate: Any) -> None:
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


def test_a_point_that_leaves_its_body_is_released(watched: Any, box: Any, crate: Any) -> None:
    """A point that slid onto the background no longer moves with the body."""
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


def test_points_are_expected_where_the_body_will_be(watched: Any, box: Any, crate: Any) -> None:
    body = box(to_the_right())
    run = watched(body, crate)
    run.run(1.5)
    place, _ = run.points.sums.static_position()
    dt = 0.3
    expected = expected_at(run.tracker.tracks, run.points, place, dt, run.parameters.obstacles)
    mine = (run.owner == 0) & (run.points.obstacle != -1)
    truth = body.places(run.time + dt)[run.which[mine]]
    assert np.median(np.linalg.norm((expected[mine] - truth)[:, [0, 2]], axis=1)) < 0.04
    # Static points are expected to stay, so no expectation is given.
    assert np.isnan(expected[run.owner == 1]).all()


def test_the_image_box_contains_the_points(watched: Any, box: Any, crate: Any) -> None:
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


def test_only_points_of_confirmed_obstacles_are_known(watched: Any, box: Any, crate: Any) -> None:
    run = watched(box(to_the_right()), crate)
    while not run.tracks:
        run.step()
    assert run.tracks[0].state is TrackState.TENTATIVE
    assert not run.tracker.known(run.points).any()
    run.run(1.0)
    assert run.tracker.known(run.points).tolist() == (run.points.obstacle != -1).tolist()
    assert run.tracker.known(run.points).any()


def test_new_points_in_the_box_of_a_body_that_moves_apart_are_known(
    watched: Any, box: Any, crate: Any
) -> None:
    """They would be taken for the background, of which nothing else may be as near."""
    body = box(to_the_right())
    run = watched(body, crate)
    run.run(2.0)
    (track,) = alive(run.tracks)
    track.outline, track.off_ground = outline_of(Solid(tuple(track.centre), SIZE), ARRIVED), True
    seen = np.flatnonzero(run.owner == 0)
    here = body.places(run.time)[run.which[seen]]
    precise = np.broadcast_to(1e4 * np.eye(3), (len(seen), 3, 3))
    new = run.points.take(seen).but(
        obstacle=np.full(len(seen), NO_OBSTACLE), sums=PositionVelocityFilter.begin(here, precise)
    )
    assert run.tracker.known(new).all()
    # What stands beside it is not, nor is what is new on a body that has stopped.
    assert not run.tracker.known(run.points)[run.owner == 1].any()
    track.motion = MotionState.STOPPED
    assert not run.tracker.known(new).any()
    # That it has just stopped may be an error; what stands for long is background.
    members = run.points.obstacle == track.id
    track.stood_s = 0.5
    assert run.tracker.seen_apart(run.points).tolist() == members.tolist()
    track.stood_s = 1.5
    assert not run.tracker.seen_apart(run.points).any()


@pytest.mark.parametrize(("name", "value"), [("confirm_sigmas", 50.0), ("confirm_hits", 12)])
def test_the_parameters_control_when_a_body_is_confirmed(
    name: str, value: float, watched: Any, box: Any, crate: Any
) -> None:
    usual, strict = (
        watched(box(to_the_right(0.25)), crate, **kinds) for kinds in ({}, {name: value})
    )
    assert alive(usual.run(0.6))
    assert not alive(strict.run(0.6))
