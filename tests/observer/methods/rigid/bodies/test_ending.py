"""When the track of a body seen as an outline ends."""

from __future__ import annotations

import numpy as np
import pytest

from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import BodyFilter
from observer.methods.rigid.bodies.lifecycle import is_over
from observer.methods.rigid.dense.free_space import STATIC
from observer.types import MotionState, TrackState

from .judging import STOOD, MakeTrack, P, judge_frames


def test_a_track_that_moves_separately_continues(outlined_track: MakeTrack) -> None:
    track = outlined_track(arrived=3)
    judge_frames(track)
    track.age_s = 10.0
    assert not any(is_over(track, P) for _ in range(20))


def ends_after(track: BodyTrack, most: int = 20) -> int | None:
    """Frames until it is over; None if it never is."""
    return next((k for k in range(1, most) if is_over(track, P)), None)


def test_a_tentative_static_outline_ends_after_a_few_frames(outlined_track: MakeTrack) -> None:
    assert ends_after(outlined_track(STOOD, evidence=STATIC)) == 4


def test_a_static_person_with_a_moving_part_does_not_end(outlined_track: MakeTrack) -> None:
    track = outlined_track(STOOD, evidence=STATIC)
    track.part_moves = True
    assert ends_after(track) is None


def test_a_static_outline_with_certainly_moving_points_does_not_end(
    outlined_track: MakeTrack,
) -> None:
    """A person coming straight on from afar hardly changes place for a second."""
    for sigma, ends in ((0.2, None), (0.5, 4)):
        track = outlined_track((0.0, 0.0, -0.8), sigma=sigma, evidence=STATIC)
        assert track.outline is not None
        track.outline.depths.measured = True
        judge_frames(track)
        assert ends_after(track) == ends


def test_a_confirmed_static_outline_does_not_end(outlined_track: MakeTrack) -> None:
    track = outlined_track(arrived=3, evidence=STATIC)
    judge_frames(track)
    assert track.state is TrackState.CONFIRMED
    assert ends_after(track) is None


def ends_while_static(track: BodyTrack, at: tuple[float, float, float], frames: int) -> list[bool]:
    """Whether it is over, for each frame in which it stands there."""
    cov = 1e-4 * np.eye(3)
    track.filter = BodyFilter.begin(np.array(at), np.array(STOOD), cov, cov, 0.01)
    over = []
    for _ in range(frames):
        judge_frames(track)
        over.append(is_over(track, P))
    return over


def test_a_track_static_where_it_was_confirmed_ends_unless_it_walked(
    outlined_track: MakeTrack,
) -> None:
    for at, ends in (((0.3, 0.0, 4.1), True), ((0.9, 0.0, 4.0), False)):
        track = outlined_track(arrived=3)
        judge_frames(track)
        over = ends_while_static(track, at, 12)
        assert not any(over[:6])
        assert any(over) is ends


def test_a_track_that_walked_and_returned_does_not_end_where_it_started(
    outlined_track: MakeTrack,
) -> None:
    track = outlined_track(arrived=3)
    judge_frames(track)
    assert not any(ends_while_static(track, (0.9, 0.0, 4.0), 2))
    assert not any(ends_while_static(track, (0.0, 0.0, 4.0), 20))


def test_motion_predicted_out_of_sight_does_not_count_as_walking(outlined_track: MakeTrack) -> None:
    track = outlined_track(arrived=3)
    judge_frames(track)
    track.missed_s = 0.1
    ends_while_static(track, (0.9, 0.0, 4.0), 2)
    track.missed_s = 0.0
    assert any(ends_while_static(track, (0.0, 0.0, 4.0), 20))


def test_short_stops_and_visible_points_do_not_end_a_track(outlined_track: MakeTrack) -> None:
    track = outlined_track(arrived=3)
    judge_frames(track)
    going = track.filter
    for _ in range(4):
        assert not any(ends_while_static(track, (0.0, 0.0, 4.0), 5))
        track.filter = going
        judge_frames(track)
    track.points = 30
    assert not any(ends_while_static(track, (0.0, 0.0, 4.0), 20))


def test_a_confirmed_track_that_absorbs_static_surroundings_ends(outlined_track: MakeTrack) -> None:
    track = outlined_track(arrived=3, evidence=STATIC)
    judge_frames(track)
    track.outline.moving_area /= 2
    assert ends_after(track) == 4


def test_occasional_idle_frames_do_not_end_a_track(outlined_track: MakeTrack) -> None:
    track = outlined_track(STOOD, evidence=STATIC)
    standing = track.outline.segment
    moving = outlined_track(STOOD).outline.segment
    for k in range(20):
        track.outline.segment = moving if k % 3 == 2 else standing
        assert not is_over(track, P)


def test_an_outline_gets_more_time_to_move_than_points(
    outlined_track: MakeTrack, make_track: MakeTrack
) -> None:
    ages = []
    for track in (outlined_track(STOOD), make_track(velocity=STOOD)):
        while not is_over(track, P):
            track.age_s += 0.1
            assert track.age_s < 5.0
        ages.append(track.age_s)
    assert ages == pytest.approx([1.5, 0.5], abs=0.11)


def test_a_track_merged_with_its_surroundings_for_too_long_ends(make_track: MakeTrack) -> None:
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


def test_a_track_without_outline_ends_only_when_static(
    outlined_track: MakeTrack,
) -> None:
    track = outlined_track(arrived=3)
    judge_frames(track)
    assert track.outline is not None
    track.outline.seen, track.merged_s, track.points = False, 1.1, 5
    assert not is_over(track, P)
    track.motion = MotionState.STOPPED
    assert is_over(track, P)


def test_a_track_out_of_sight_coasts_and_then_ends(outlined_track: MakeTrack) -> None:
    track = outlined_track(arrived=3)
    judge_frames(track)
    track.outline.seen, track.missed_s = False, P.coast_s
    assert judge_frames(track) is TrackState.COASTING
    assert not is_over(track, P)
    track.missed_s = P.coast_s + 0.01
    assert is_over(track, P)
