"""A run as the alignment sees it: its curves, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from observer.errors import TruthError
from observer.truth.alignment.observed import ObservedRun, ObservedTrack, TrackKey

from .conftest import Room


def test_speeds_dated_before_an_earlier_one_are_left_out() -> None:
    dated = np.array([0.95, 1.05, 1.15, 1.25, 1.0, 1.1, 1.2, 1.35])
    times = np.linspace(1.0, 1.7, 8)
    unknown = np.full(8, np.nan)
    track = ObservedTrack(TrackKey(0, 1), times, np.zeros((8, 3)), dated, np.arange(8.0), unknown)
    curve = track.speed_curve()
    assert curve is not None
    assert curve.times.tolist() == [0.95, 1.05, 1.15, 1.25, 1.35]
    assert curve.values.tolist() == [0.0, 1.0, 2.0, 3.0, 7.0]


def test_run_whose_clock_restarted_is_refused_for_that_reason(room: Room) -> None:
    again = [{**line, "segment": 1} for line in room.lines]
    with pytest.raises(
        TruthError,
        match=r"clock restarted during the run, after 25\.7\d* s \(line 388 of .*record it again",
    ):
        ObservedRun.of_lines([*room.lines, *again]).own_curves()
