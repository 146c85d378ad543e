"""Observation lines: what was written is read back unchanged."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import get_args

import numpy as np

from observer.drawing import silhouette_mask
from observer.evaluation.lines import checked_lines
from observer.jsonl import MotionWord, StateWord, StatusWord, observation_line
from observer.types import MotionState, Observation, Obstacle, Status, TrackState

from .builders import an_obstacle

PART = np.array([[3.0, 2.0], [20.0, 2.0], [20.0, 30.0], [3.0, 31.0]])
OTHER = np.array([[40.0, 5.0], [44.0, 5.0], [42.0, 9.0]])


def obstacle() -> Obstacle:
    return an_obstacle(box_px=(3.0, 2.0, 44.0, 31.0), silhouette=(PART, OTHER))


def observed(*obstacles: Obstacle) -> Observation:
    return Observation(7, 0.5, 1.0, 0, Status.OK, (), 0, None, obstacles)


def test_a_silhouette_is_written_as_whole_pixels_and_read_back() -> None:
    text = json.dumps(observation_line(observed(obstacle())), allow_nan=False)
    # Compact: no decimals.
    assert (
        '"silhouette": [[[3, 2], [20, 2], [20, 30], [3, 31]], [[40, 5], [44, 5], [42, 9]]]' in text
    )
    (entry,) = json.loads(text)["obstacles"]
    read = silhouette_mask(entry["silhouette"], (40, 60))
    assert np.array_equal(read, silhouette_mask((PART, OTHER), (40, 60)))
    assert read[2, 3]
    assert read[6, 42]
    assert not read[20, 30]


def test_a_missing_silhouette_is_null() -> None:
    line = observation_line(observed(replace(obstacle(), silhouette=None)))
    assert line["obstacles"][0]["silhouette"] is None


def test_evaluation_accepts_lines_with_and_without_silhouettes() -> None:
    line = observation_line(observed(obstacle()))
    (entry,) = line["obstacles"]
    older = {name: value for name, value in entry.items() if name != "silhouette"}
    assert checked_lines([line]) == checked_lines([{**line, "obstacles": [older]}])


def test_the_words_are_those_of_the_enumerations() -> None:
    assert get_args(StatusWord) == tuple(Status)
    assert get_args(StateWord) == tuple(TrackState)
    assert get_args(MotionWord) == tuple(MotionState)
