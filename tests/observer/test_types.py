"""Frames are validated on construction; values derived from a result are correct."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from observer.evaluation.lines import checked_lines
from observer.jsonl import observation_line
from observer.methods.planar.results import ResidualFlow
from observer.types import Observation, Obstacle, Status, StereoFrame, TrackState, Unseen

from .builders import an_obstacle

GREY = np.zeros((4, 6), np.uint8)
COLOUR = np.zeros((4, 6, 3), np.uint8)


@pytest.mark.parametrize(("left", "right"), [(GREY, GREY), (COLOUR, COLOUR), (GREY, COLOUR)])
def test_valid_frames_are_accepted(left: np.ndarray, right: np.ndarray) -> None:
    assert StereoFrame(0, 1.5, left, right, 2.0).right_time is None


@pytest.mark.parametrize(
    ("left", "right", "time", "sentence"),
    [
        (GREY.astype(np.float32), GREY, 0.0, "the left image must be 8 bit"),
        (GREY, GREY.astype(np.uint16), 0.0, "the right image must be 8 bit"),
        (GREY[:0], GREY[:0], 0.0, "not empty"),
        (GREY, np.zeros((4, 6, 4), np.uint8), 0.0, "3 channels"),
        (GREY, np.zeros((4, 8), np.uint8), 0.0, "not 6x4 and 8x4"),
        (GREY, GREY, np.nan, "must be finite"),
        (GREY, GREY, np.inf, "must be finite"),
    ],
)
def test_invalid_frames_are_refused(
    left: np.ndarray, right: np.ndarray, time: float, sentence: str
) -> None:
    with pytest.raises(ValueError, match=sentence):
        StereoFrame(0, time, left, right, 0.0)


def obstacle(state: TrackState, position: tuple[float, float, float] = (0, 0, 2)) -> Obstacle:
    return an_obstacle(state=state, position_camera=np.array(position, float))


def test_range_and_bearing_of_an_obstacle() -> None:
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


UNSEEN = Unseen(0.5, {"plain": 0.25, "dark": 0.25}, 16, ("p.", ".d"), hides_person=True)


@pytest.mark.parametrize(
    ("px", "cause"),
    [
        ((-0.5, -0.5), "plain"),
        ((15.4, 15.4), "plain"),
        ((15.6, 15.4), None),
        ((15.6, 15.6), "dark"),
        ((40.0, 40.0), "dark"),
    ],
)
def test_a_pixel_has_the_cause_of_its_cell(px: tuple[float, float], cause: str | None) -> None:
    assert UNSEEN.cause_at(px) == cause


def test_unseen_regions_are_a_reason_only_if_they_can_hide_a_person() -> None:
    (reason,) = UNSEEN.reasons
    assert reason == (
        "motion could not be detected in 50 % of the view, including an area large enough to hide "
        "a person: too little texture (25 %), too dark or saturated (25 %)"
    )
    assert replace(UNSEEN, hides_person=False).reasons == ()


def test_possible_new_motion_is_a_separate_reason() -> None:
    causes = {"plain": 0.25, "dark": 0.25, "tentative": 0.25}
    unseen = replace(UNSEEN, causes=causes, rows=("pt", ".d"))
    assert unseen.cause_at((20.0, 4.0)) == "tentative"
    assert unseen.reasons == (
        *UNSEEN.reasons,
        "something may have started to move; not confirmed yet",
    )
    (reason,) = replace(unseen, hides_person=False).reasons
    assert reason.startswith("something may have started to move")


def test_evaluation_reads_unseen_regions_from_a_json_line() -> None:
    seen = Observation(0, 0.0, 0.0, 0, Status.DEGRADED, UNSEEN.reasons, 0, None, (), unseen=UNSEEN)
    line = json.loads(json.dumps(observation_line(seen)))
    (read,) = checked_lines([line])
    assert read.unseen is not None
    assert read.unseen.model_dump() == {
        "share": 0.5,
        "causes": {"plain": 0.25, "dark": 0.25},
        "cell_px": 16,
        "rows": ("p.", ".d"),
    }
    (without,) = checked_lines([observation_line(replace(seen, unseen=None))])
    assert without.unseen is None
