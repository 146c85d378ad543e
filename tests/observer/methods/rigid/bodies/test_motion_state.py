"""Whether a body counts as moving or as stopped."""

from __future__ import annotations

from dataclasses import replace

import pytest

from observer.types import MotionState, TrackState

from .judging import STOOD, MakeTrack, judge_frames


def test_a_body_out_of_sight_stays_moving_however_uncertain(make_track: MakeTrack) -> None:
    for missed_s, motion in ((0.0, MotionState.STOPPED), (1.0, MotionState.MOVING)):
        track = make_track(velocity=(0.5, 0.0, 0.0), sigma=0.3)
        track.state, track.missed_s = TrackState.CONFIRMED, missed_s
        judge_frames(track)
        assert track.motion is motion


def test_losing_the_velocity_does_not_count_as_stopping(outlined_track: MakeTrack) -> None:
    """Points on limbs were taken for the body, so it may be slower or faster than they are."""
    track = outlined_track(arrived=3)
    judge_frames(track)
    assert (track.state, track.motion) == (TrackState.CONFIRMED, MotionState.MOVING)
    track.outline.segment = replace(track.outline.segment, arrived=0.3)
    for sigma, motion in ((0.5, MotionState.MOVING), (0.1, MotionState.STOPPED)):
        track.filter = outlined_track((0.2, 0.0, 0.0), sigma=sigma).filter
        judge_frames(track)
        assert track.motion is motion


def test_a_returning_body_with_unknown_velocity_has_not_stopped(
    outlined_track: MakeTrack,
) -> None:
    track = outlined_track(arrived=3)
    judge_frames(track)
    track.filter = outlined_track(STOOD, sigma=1.0).filter
    judge_frames(track)
    assert track.motion is MotionState.MOVING
    # If that lasts, the body has not come back: something else is there.
    judge_frames(track, 10)
    assert track.motion is MotionState.STOPPED


def test_a_body_that_stays_in_its_cells_has_stopped(
    outlined_track: MakeTrack,
) -> None:
    track = outlined_track(arrived=3)
    judge_frames(track)
    track.filter = outlined_track((0.2, 0.0, 0.0), sigma=0.5).filter
    for static, motion in ((0.9, MotionState.MOVING), (1.0, MotionState.STOPPED)):
        segment = track.outline.segment
        track.outline.segment = replace(segment, static=static, arrived=1 - static)
        judge_frames(track)
        assert track.motion is motion


def test_a_body_that_still_enters_free_space_has_not_stopped(outlined_track: MakeTrack) -> None:
    """Of somebody near, whose legs swing, the velocity may not be significant for a while."""
    for arrived, speed, motion in (
        (0.9, 0.3, MotionState.MOVING),
        (0.3, 0.3, MotionState.STOPPED),
        (0.9, 0.1, MotionState.STOPPED),
    ):
        track = outlined_track(arrived=3)
        judge_frames(track)
        assert track.motion is MotionState.MOVING
        track.filter = outlined_track((speed, 0.0, 0.0), sigma=0.2).filter
        track.outline.segment = replace(track.outline.segment, arrived=arrived)
        judge_frames(track)
        assert track.motion is motion


def test_an_uncertain_unreported_body_does_not_count_as_moving(
    outlined_track: MakeTrack,
) -> None:
    track = outlined_track((0.5, 0.0, 0.0), sigma=0.5)
    judge_frames(track)
    assert track.motion is MotionState.STOPPED


@pytest.mark.parametrize(
    ("speed", "sigmas", "motion"),
    [
        (0.4, 2.4, MotionState.MOVING),
        (0.4, 1.6, MotionState.STOPPED),
        (0.12, 2.4, MotionState.STOPPED),
    ],
)
def test_a_moving_body_stays_moving_when_its_speed_becomes_uncertain(
    make_track: MakeTrack, speed: float, sigmas: float, motion: MotionState
) -> None:
    track = make_track((0.0, 0.0, 4.0), (0.0, 0.0, -speed), sigma=speed / sigmas)
    track.state, track.motion = TrackState.CONFIRMED, MotionState.MOVING
    judge_frames(track)
    assert track.motion is motion


def test_a_body_that_never_certainly_moved_does_not_count_as_moving(make_track: MakeTrack) -> None:
    for state in (TrackState.TENTATIVE, TrackState.CONFIRMED):
        track = make_track((0.0, 0.0, 4.0), (0.0, 0.0, -0.4), sigma=0.4 / 2.4)
        track.state, track.motion = state, MotionState.STOPPED
        judge_frames(track)
        assert track.motion is MotionState.STOPPED
