"""When the track of a body seen as an outline ends."""

from __future__ import annotations

import numpy as np
import pytest

from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import BodyFilter
from observer.methods.rigid.bodies.lifecycle import is_over
from observer.methods.rigid.dense.free_space import STATIC
from observer.types import MotionState, TrackState

from .judging import STOOD, MakeTrack, P, judged


def test_what_moves_as_a_thing_of_its_own_goes_on(guest: MakeTrack) -> None:
    track = guest(arrived=3)
    judged(track)
    track.age_s = 10.0
    assert not any(is_over(track, P) for _ in range(20))


def ends_after(track: BodyTrack, most: int = 20) -> int | None:
    """Frames until it is over; None if it never is."""
    return next((k for k in range(1, most) if is_over(track, P)), None)


def test_a_tentative_outline_that_stands_ends_after_a_few_frames(guest: MakeTrack) -> None:
    assert ends_after(guest(STOOD, evidence=STATIC)) == 4


def test_a_person_of_whom_a_part_moved_may_stand(guest: MakeTrack) -> None:
    track = guest(STOOD, evidence=STATIC)
    track.part_moves = True
    assert ends_after(track) is None


def test_one_whose_points_tell_that_it_moves_may_stand(guest: MakeTrack) -> None:
    """A person coming straight on from afar hardly changes place for a second."""
    for sigma, ends in ((0.2, None), (0.5, 4)):
        track = guest((0.0, 0.0, -0.8), sigma=sigma, evidence=STATIC)
        assert track.outline is not None
        track.outline.depths.measured = True
        judged(track)
        assert ends_after(track) == ends


def test_a_confirmed_one_may_stand(guest: MakeTrack) -> None:
    track = guest(arrived=3, evidence=STATIC)
    judged(track)
    assert track.state is TrackState.CONFIRMED
    assert ends_after(track) is None


def ends_while_static(track: BodyTrack, at: tuple[float, float, float], frames: int) -> list[bool]:
    """Whether it is over, for each frame in which it stands there."""
    cov = 1e-4 * np.eye(3)
    track.filter = BodyFilter.begin(np.array(at), np.array(STOOD), cov, cov, 0.01)
    over = []
    for _ in range(frames):
        judged(track)
        over.append(is_over(track, P))
    return over


def test_one_that_stands_where_it_was_confirmed_ends_and_one_that_walked_stays(
    guest: MakeTrack,
) -> None:
    for at, ends in (((0.3, 0.0, 4.1), True), ((0.9, 0.0, 4.0), False)):
        track = guest(arrived=3)
        judged(track)
        over = ends_while_static(track, at, 12)
        assert not any(over[:6])
        assert any(over) is ends


def test_one_that_walked_and_came_back_does_not_end_where_it_began(guest: MakeTrack) -> None:
    track = guest(arrived=3)
    judged(track)
    assert not any(ends_while_static(track, (0.9, 0.0, 4.0), 2))
    assert not any(ends_while_static(track, (0.0, 0.0, 4.0), 20))


def test_where_it_would_be_out_of_sight_it_was_not_seen_to_walk(guest: MakeTrack) -> None:
    track = guest(arrived=3)
    judged(track)
    track.missed_s = 0.1
    ends_while_static(track, (0.9, 0.0, 4.0), 2)
    track.missed_s = 0.0
    assert any(ends_while_static(track, (0.0, 0.0, 4.0), 20))


def test_a_short_stop_and_points_that_show_it_end_nothing(guest: MakeTrack) -> None:
    track = guest(arrived=3)
    judged(track)
    going = track.filter
    for _ in range(4):
        assert not any(ends_while_static(track, (0.0, 0.0, 4.0), 5))
        track.filter = going
        judged(track)
    track.points = 30
    assert not any(ends_while_static(track, (0.0, 0.0, 4.0), 20))


def test_a_confirmed_one_that_swallows_what_stands_ends(guest: MakeTrack) -> None:
    track = guest(arrived=3, evidence=STATIC)
    judged(track)
    track.outline.moving_area /= 2
    assert ends_after(track) == 4


def test_one_idle_frame_now_and_then_ends_nothing(guest: MakeTrack) -> None:
    track = guest(STOOD, evidence=STATIC)
    standing = track.outline.segment
    moving = guest(STOOD).outline.segment
    for k in range(20):
        track.outline.segment = moving if k % 3 == 2 else standing
        assert not is_over(track, P)


def test_an_outline_is_given_more_time_to_move_than_points_are(
    guest: MakeTrack, make_track: MakeTrack
) -> None:
    ages = []
    for track in (guest(STOOD), make_track(velocity=STOOD)):
        while not is_over(track, P):
            track.age_s += 0.1
            assert track.age_s < 5.0
        ages.append(track.age_s)
    assert ages == pytest.approx([1.5, 0.5], abs=0.11)


def test_who_has_been_one_with_its_surroundings_for_long_ends(make_track: MakeTrack) -> None:
    track = make_track()
    track.state, track.merged_s = TrackState.CONFIRMED, 0.9
    assert not is_over(track, P)
    track.merged_s = 1.1
    assert is_over(track, P)
    # Many points that keep moving still show it.
    track.points = 20
    assert not is_over(track, P)
    track.motion = MotionState.STOPPED
    assert is_over(track, P)


def test_who_lost_its_outline_ends_when_it_stands_and_not_while_it_drives(guest: MakeTrack) -> None:
    track = guest(arrived=3)
    judged(track)
    assert track.outline is not None
    track.outline.seen, track.merged_s, track.points = False, 1.1, 5
    assert not is_over(track, P)
    track.motion = MotionState.STOPPED
    assert is_over(track, P)


def test_who_is_out_of_sight_coasts_and_then_ends(guest: MakeTrack) -> None:
    track = guest(arrived=3)
    judged(track)
    track.outline.seen, track.missed_s = False, P.coast_s
    assert judged(track) is TrackState.COASTING
    assert not is_over(track, P)
    track.missed_s = P.coast_s + 0.01
    assert is_over(track, P)
