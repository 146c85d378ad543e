"""Source times for host times, however a busy machine delays frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from app.contract.drive import WheelSpeedEvent
from app.server.robots.wheels import WheelLog
from app.server.source_time import RisingTimes, SourceTime

# Seconds: host minus source.
_OFFSET_S = 900.0
_STEP_S = 1 / 15


@dataclass(frozen=True)
class Seen:
    """An observation, reduced to its times."""

    received: float
    line: dict[str, Any]


def frame(number: int, late_s: float, segment: int = 0) -> Any:
    time = number * _STEP_S
    return Seen(time + _OFFSET_S + late_s, {"time": time, "segment": segment})


def busy_frames(seed: int, seconds: float) -> list[Any]:
    """Return frames of which one in five is received up to 0.4 s late, delaying those after it."""
    rng = np.random.default_rng(seed)
    count = int(seconds / _STEP_S)
    late = rng.gamma(2.0, 2e-3, count)
    late[rng.random(count) < 0.2] += rng.uniform(0.0, 0.4)
    received = np.maximum.accumulate(np.arange(count) * _STEP_S + late)
    return [frame(k, float(received[k]) - k * _STEP_S) for k in range(count)]


@pytest.mark.parametrize("seed", range(5))
def test_robot_times_increase_on_a_busy_machine(seed: int) -> None:
    source, rising = SourceTime(), RisingTimes()
    rng = np.random.default_rng(seed + 100)
    told: list[tuple[float, float]] = []
    heard = _OFFSET_S + 0.05
    for event in busy_frames(seed, 40.0):
        source.observed(event)
        # A robot reports ten times a second; on a busy machine its reports are read in batches.
        while heard < event.received - rng.uniform(0.0, 0.3):
            instant = rising.of("obstacle", source.at(heard))
            if instant is not None:
                told.append((heard, instant.time))
            heard += 0.1
    host, times = np.array(told).T
    assert len(told) > 200
    assert (np.diff(times) > 0).all()
    # Late only by the minimum delay of frames, once a second or two of them have been seen.
    assert np.abs(times - (host - _OFFSET_S))[host > host[0] + 2].max() < 0.02


def test_without_frames_the_time_is_unknown() -> None:
    source = SourceTime()
    assert source.at(_OFFSET_S) is None
    for number in (*range(30), *range(45, 60)):
        source.observed(frame(number, 0.0))
    before = 29 * _STEP_S + _OFFSET_S
    found = source.at(before + 0.2)
    assert found is not None
    assert found.time == pytest.approx(29 * _STEP_S + 0.2, abs=1e-6)
    # A second without a frame, though the next one is already known.
    assert source.at(before + 0.5) is None
    assert source.at(before + 1.1) is not None
    source.live = True
    assert source.at(before + 0.5) is not None
    assert source.at(_OFFSET_S - 1.0) is None


def test_a_slow_sources_time_continues_between_frames() -> None:
    source = SourceTime()
    for number in range(5):
        source.observed(Seen(_OFFSET_S + number, {"time": float(number), "segment": 0}))  # type: ignore[arg-type]
    assert source.at(_OFFSET_S + 6.0) is not None
    assert source.at(_OFFSET_S + 8.0) is None


def test_a_restarted_source_has_a_new_clock() -> None:
    source, rising = SourceTime(), RisingTimes()
    for number in range(30):
        source.observed(frame(number, 0.0))
    first = rising.of("observer", source.at(_OFFSET_S + 1.9))
    again = Seen(_OFFSET_S + 2.0, {"time": 0.0, "segment": 3})
    source.observed(again)  # type: ignore[arg-type]
    second = rising.of("observer", source.at(_OFFSET_S + 2.05))
    assert first is not None
    assert second is not None
    assert (second.time, second.segment) == (pytest.approx(0.05), 3)
    source.begin()
    assert source.at(_OFFSET_S + 2.1) is None


def test_a_repeated_sample_is_taken_once() -> None:
    source, log = SourceTime(), WheelLog()
    source.observed(frame(3, 0.0, segment=2))
    event = WheelSpeedEvent("observer", _OFFSET_S + 0.25, 0.3, 0.25)
    sample = log.take(event, source.at(event.time))
    assert sample is not None
    assert (sample.time, sample.segment) == (pytest.approx(0.25), 2)
    assert log.take(event, source.at(event.time)) is None
    late = WheelSpeedEvent("observer", _OFFSET_S + 0.22, 0.3, 0.25)
    assert log.take(late, source.at(late.time)) is None
    other = WheelSpeedEvent("obstacle", _OFFSET_S + 0.22, 0.3, 0.25)
    assert log.take(other, source.at(other.time)) is not None
