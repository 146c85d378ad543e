"""The run's clock and length, shared by page, chart and report."""

from __future__ import annotations

import pytest

from observer.recording.run_time import RunTime

STEP = 1 / 15


def _added(clock: RunTime, begin: float, count: int, received: float, pace: float = 1.0) -> None:
    for k in range(count):
        clock.add(begin + k * STEP, received + pace * k * STEP)


@pytest.mark.parametrize("pace", [0.05, 1.0, 8.0])
def test_the_length_of_a_run_does_not_depend_on_processing_speed(pace: float) -> None:
    clock = RunTime()
    _added(clock, 4.0, 31, 100.0, pace)
    assert clock.begin_s == 4.0
    assert clock.duration_s == pytest.approx(2.0)
    assert clock.offset_s == 0.0


def test_a_run_without_frames_has_no_length() -> None:
    clock = RunTime()
    assert (clock.begin_s, clock.duration_s) == (None, None)
    clock.add(7.0, 100.0)
    assert (clock.begin_s, clock.duration_s) == (7.0, 0.0)


def test_a_gap_of_a_live_camera_counts_even_after_reopening() -> None:
    for reopened in (False, True):
        clock = RunTime()
        _added(clock, 50.0, 16, 100.0)
        # The camera's clock continues; the host took a little longer.
        assert clock.add(54.0, 104.3, reopened=reopened) == 54.0
        assert clock.duration_s == pytest.approx(4.0)


@pytest.mark.parametrize("begin", [0.0, 5e5])
def test_a_restarted_clock_continues_after_one_step(begin: float) -> None:
    clock = RunTime()
    _added(clock, 10.0, 16, 100.0)
    assert clock.add(begin, 104.0, reopened=True) == pytest.approx(11.0 + STEP)
    assert clock.add(begin + 0.5, 104.5) == pytest.approx(11.5 + STEP)
    assert clock.duration_s == pytest.approx(1.5 + STEP)
