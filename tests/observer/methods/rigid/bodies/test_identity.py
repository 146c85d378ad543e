"""Identity of an obstacle over time: hidden, crossed by another one, found in parts."""

from __future__ import annotations

from itertools import count
from typing import Any

import numpy as np
import pytest

from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.shape import Box
from observer.methods.rigid.bodies.tracker import BodyTracker
from observer.methods.rigid.position_velocity_filter import PositionVelocityFilter
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.parameters import Parameters
from observer.types import MotionState, TrackState
from observer.vision.lifecycle import NO_OBSTACLE, TrackIds

from ..solid_worlds import outline_of, person
from .planted_bodies import DT, alive, to_the_right


def test_the_number_is_provisional_until_confirmation_and_then_permanent(
    watched: Any, box: Any, crate: Any
) -> None:
    run = watched(box(to_the_right()), crate)
    run.tracker = BodyTracker(TrackIds(count(7)))
    seen = []
    for _ in range(25):
        seen += [(t.state is TrackState.TENTATIVE, t.id) for t in run.step()]
        # Its points carry the same number.
        for track in run.tracks:
            assert np.count_nonzero(run.points.obstacle == track.id) == track.points or not (
                track.points
            )
        known = {t.id for t in run.tracks} | {NO_OBSTACLE}
        assert set(run.points.obstacle.tolist()) <= known
    assert all(number < NO_OBSTACLE for tentative, number in seen if tentative)
    assert {number for tentative, number in seen if not tentative} == {7}
    assert sum(not tentative for tentative, _ in seen) > 15


def test_a_confirmed_track_keeps_its_number_when_merged_with_an_older_one(
    make_track: Any,
) -> None:
    older, younger = make_track(number=-2), make_track(number=4)
    younger.state = TrackState.CONFIRMED
    tracker = BodyTracker(TrackIds(count(9)))
    tracker.tracks = [older, younger]
    points = tracker.update_lifecycle(
        TrackedPoints.none(), np.zeros(3), lambda _: 0.1, 1 / 15, Parameters().obstacles
    )
    assert len(points) == 0
    assert [(t.id, t.state) for t in tracker.tracks] == [(4, TrackState.CONFIRMED)]
    assert tracker.tracks[0] is older


@pytest.mark.parametrize("hidden_s", [0.4, 1.0])
def test_a_hidden_body_coasts_along_its_path_and_keeps_its_number(
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


def test_a_body_seen_after_the_end_of_its_track_gets_a_new_number(
    watched: Any, box: Any, crate: Any
) -> None:
    run = watched(box(to_the_right(x=-0.9), seen=lambda t: not 1.5 <= t < 2.5), crate, coast_s=0.3)
    run.run(1.5 - DT)
    (before,) = alive(run.tracks)
    run.run(2.0)
    (after,) = alive(run.tracks)
    assert after.id > before.id


def test_a_body_that_stops_and_drives_on_keeps_its_number(
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


def test_two_crossing_bodies_keep_their_numbers(watched: Any, box: Any) -> None:
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


def test_a_body_found_in_two_parts_becomes_one_track(watched: Any, planted: Any) -> None:
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
def test_points_at_the_position_of_a_hidden_person_do_not_show_them(
    make_track: Any, rigid: bool, seen: bool, joined: bool
) -> None:
    """A mere shadow could have such points. Points of a rigid body do show it."""
    whole = Box(np.zeros(3), np.array([0.5, 1.7, 0.3]), 0.0)
    older, part = make_track(box=whole), make_track((0.1, 0.1, 3.0), number=2)
    older.outline = outline_of(person(0.0, 3.0))
    older.outline.seen, older.rigid = seen, rigid
    older.outline.middle = older.centre
    tracker = BodyTracker(TrackIds(count(9)))
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


def test_a_duplicate_is_merged_into_the_older_track(watched: Any, box: Any, crate: Any) -> None:
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


def test_numbers_continue_in_the_next_segment(watched: Any, box: Any, crate: Any) -> None:
    run, numbers = watched(box(to_the_right(x=-1.0)), crate), TrackIds()
    run.tracker = BodyTracker(numbers)
    run.run(1.0)
    (first,) = alive(run.tracks)
    run.tracker = BodyTracker(numbers)
    run.points = run.points.but(obstacle=np.full(len(run.points), -1))
    assert run.tracks == []
    run.run(0.6)
    (second,) = alive(run.tracks)
    assert second.id > first.id


def test_numbers_can_be_supplied_by_the_caller(watched: Any, box: Any, crate: Any) -> None:
    """A caller that keeps them over segments can supply them."""
    run = watched(box(to_the_right()), crate)
    run.tracker = BodyTracker(TrackIds(count(40)))
    run.run(1.0)
    assert {t.id for t in run.tracks} == {40}
