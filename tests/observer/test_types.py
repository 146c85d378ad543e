"""Frames are checked at the door; what is derived from a result is right."""

from __future__ import annotations

import numpy as np
import pytest

from observer.methods.planar.results import ResidualFlow
from observer.types import (
    FullTrace,
    MotionState,
    NoTrace,
    Observation,
    Obstacle,
    Status,
    StereoFrame,
    TrackState,
)

GREY = np.zeros((4, 6), np.uint8)
COLOUR = np.zeros((4, 6, 3), np.uint8)


@pytest.mark.parametrize(("left", "right"), [(GREY, GREY), (COLOUR, COLOUR), (GREY, COLOUR)])
def test_good_frames_are_taken(left: np.ndarray, right: np.ndarray) -> None:
    assert StereoFrame(0, 1.5, left, right, 2.0).right_time is None


@pytest.mark.parametrize(
    ("left", "right", "time", "sentence"),
    [
        (GREY.astype(np.float32), GREY, 0.0, "the left image must be 8 bit"),
        (GREY, GREY.astype(np.uint16), 0.0, "the right image must be 8 bit"),
        (GREY[:0], GREY[:0], 0.0, "not empty"),
        (GREY, np.zeros((4, 6, 4), np.uint8), 0.0, "3 channels"),
        (GREY, np.zeros((4, 8), np.uint8), 0.0, "not 6x4 and 8x4"),
        (GREY, GREY, np.nan, "times must be finite"),
        (GREY, GREY, np.inf, "times must be finite"),
    ],
)
def test_bad_frames_are_refused(
    left: np.ndarray, right: np.ndarray, time: float, sentence: str
) -> None:
    with pytest.raises(ValueError, match=sentence):
        StereoFrame(0, time, left, right, 0.0)


def obstacle(state: TrackState, position: tuple[float, float, float] = (0, 0, 2)) -> Obstacle:
    return Obstacle(
        id=1,
        state=state,
        motion=MotionState.MOVING,
        position_camera=np.array(position, float),
        velocity_camera=np.zeros(3),
        position=None,
        velocity=None,
        position_cov=None,
        velocity_cov=None,
        velocity_time=0.0,
        speed=0.0,
        speed_std=None,
        size=np.ones(3),
        orientation_wxyz=None,
        closing_speed=None,
        points=4,
        significance=3.0,
        box_px=(0.0, 0.0, 1.0, 1.0),
        reason="",
    )


def test_range_and_bearing() -> None:
    o = obstacle(TrackState.CONFIRMED, (1.0, 2.0, 2.0))
    assert o.range == pytest.approx(3.0)
    assert o.bearing == pytest.approx(np.arctan2(1, 2))
    assert obstacle(TrackState.CONFIRMED, (-1.0, 0, 1.0)).bearing < 0


def test_only_confirmed_and_coasting_obstacles_are_reported() -> None:
    all_states = tuple(obstacle(state) for state in TrackState)
    observation = Observation(0, 0.0, 0.0, 0, Status.OK, (), 0, None, all_states)
    assert {o.state for o in observation.reported} == {TrackState.CONFIRMED, TrackState.COASTING}


def test_the_residual_is_observed_minus_predicted() -> None:
    flow = ResidualFlow(
        np.array([[1, 2]], np.float32), np.array([[4, 1]], np.float32), np.array([True])
    )
    np.testing.assert_array_equal(flow.residual_px, [[3, -1]])
    assert len(flow.px) == 1


def test_traces() -> None:
    full = FullTrace()
    for trace in (full, NoTrace()):
        trace.keep("left", 1)
    assert full == {"left": 1}
