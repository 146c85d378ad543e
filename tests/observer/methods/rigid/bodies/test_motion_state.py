"""Whether a body counts as moving or as stopped."""

from __future__ import annotations

from dataclasses import replace

import pytest

from observer.types import MotionState, TrackState

from .judging import STOOD, MakeTrack, judged


def test_out_of_sight_a_body_moves_on_as_it_did_however_uncertain(make_track: MakeTrack) -> None:
    for missed_s, motion in ((0.0, MotionState.STOPPED), (1.0, MotionState.MOVING)):
        track = make_track(velocity=(0.5, 0.0, 0.0), sigma=0.3)
        track.state, track.missed_s = TrackState.CONFIRMED, missed_s
        judged(track)
        assert track.motion is motion


def test_whose_velocity_is_not_known_any_more_has_not_stopped_for_that(guest: MakeTrack) -> None:
    """Points on limbs were taken for the body, so it may be slower or faster than they are."""
    track = guest(arrived=3)
    judged(track)
    assert (track.state, track.motion) == (TrackState.CONFIRMED, MotionState.MOVING)
    for sigma, motion in ((0.5, MotionState.MOVING), (0.1, MotionState.STOPPED)):
        track.filter = guest((0.2, 0.0, 0.0), sigma=sigma).filter
        judged(track)
        assert track.motion is motion


def test_who_comes_back_and_of_whose_velocity_nothing_is_known_yet_has_not_stopped(
    guest: MakeTrack,
) -> None:
    track = guest(arrived=3)
    judged(track)
    track.filter = guest(STOOD, sigma=1.0).filter
    judged(track)
    assert track.motion is MotionState.MOVING
    # If that lasts, the body has not come back: something else is there.
    judged(track, 10)
    assert track.motion is MotionState.STOPPED


def test_who_fills_what_was_filled_before_has_stopped_however_uncertain(guest: MakeTrack) -> None:
    track = guest(arrived=3)
    judged(track)
    track.filter = guest((0.2, 0.0, 0.0), sigma=0.5).filter
    for static, motion in ((0.9, MotionState.MOVING), (1.0, MotionState.STOPPED)):
        track.outline.segment = replace(track.outline.segment, static=static)
        judged(track)
        assert track.motion is motion


def test_what_was_not_reported_yet_and_is_hardly_known_does_not_move(guest: MakeTrack) -> None:
    track = guest((0.5, 0.0, 0.0), sigma=0.5)
    judged(track)
    assert track.motion is MotionState.STOPPED


@pytest.mark.parametrize(
    ("speed", "sigmas", "motion"),
    [
        (0.4, 2.4, MotionState.MOVING),
        (0.4, 1.6, MotionState.STOPPED),
        (0.12, 2.4, MotionState.STOPPED),
    ],
)
def test_one_that_moves_is_not_said_to_stand_because_its_speed_became_uncertain(
    make_track: MakeTrack, speed: float, sigmas: float, motion: MotionState
) -> None:
    track = make_track((0.0, 0.0, 4.0), (0.0, 0.0, -speed), sigma=speed / sigmas)
    track.state, track.motion = TrackState.CONFIRMED, MotionState.MOVING
    judged(track)
    assert track.motion is motion


def test_what_was_never_sure_to_move_is_not_said_to(make_track: MakeTrack) -> None:
    for state in (TrackState.TENTATIVE, TrackState.CONFIRMED):
        track = make_track((0.0, 0.0, 4.0), (0.0, 0.0, -0.4), sigma=0.4 / 2.4)
        track.state, track.motion = state, MotionState.STOPPED
        judged(track)
        assert track.motion is MotionState.STOPPED
