"""Timestamps converted to rising seconds, whatever the server's clock does."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.truth.live.stamps import StampReader, Timed

from .arrivals import arrivals


class Read:
    """What a reader made of the timestamps."""

    def __init__(self, *, counts: bool = False) -> None:
        self.notices: list[tuple[str, str]] = []
        self.timed: list[Timed[int]] = []
        self.reader = StampReader[int](lambda *notice: self.notices.append(notice), counts=counts)
        self._fed = 0

    def feed(self, stamps: np.ndarray, received: np.ndarray) -> None:
        for stamp, arrival in zip(stamps.tolist(), received.tolist(), strict=True):
            self.timed += self.reader.feed(stamp, arrival, self._fed)
            self._fed += 1

    @property
    def kinds(self) -> list[str]:
        return [kind for kind, _ in self.notices]

    @property
    def times(self) -> np.ndarray:
        return np.array([each.time for each in self.timed])


@given(
    st.lists(
        st.tuples(st.integers(0, 2**32 - 1) | st.integers(0, 50), st.floats(0, 0.2)), max_size=80
    ),
    st.booleans(),
    st.integers(0, 79),
)
def test_any_stamps_give_finite_times_in_arrival_order(
    arrived: list[tuple[int, float]], counts: bool, anew: int
) -> None:
    read = Read(counts=counts)
    received = 1000 + np.cumsum([wait for _, wait in arrived])
    stamps = np.array([float(stamp) for stamp, _ in arrived])
    read.feed(stamps[:anew], received[:anew])
    read.reader.restart()
    read.feed(stamps[anew:], received[anew:])
    items = [each.item for each in read.timed]
    assert items == sorted(set(items))
    assert np.isfinite(read.times).all()


def test_seconds_are_unchanged() -> None:
    stamps, received = arrivals(1, 20.0, drift_ppm=100.0)
    read = Read()
    read.feed(stamps, received)
    assert [each.item for each in read.timed] == list(range(2000))
    assert (read.times == stamps).all()
    assert not read.notices


@pytest.mark.parametrize("tick_hz", [100.0, 250.0, 1e6, 1e7])
def test_ticks_are_detected_and_converted_to_seconds(tick_hz: float) -> None:
    sent, received = arrivals(2, 20.0, offset_s=0.0, drift_ppm=40.0)
    read = Read()
    read.feed(np.round(sent * tick_hz), received)
    assert read.kinds == ["stamps"]
    assert f"{tick_hz:g} per second" in read.notices[0][1]
    assert len(read.timed) == 2000
    assert np.abs(np.diff(read.times) - np.diff(sent)).max() <= 1 / tick_hz + 1e-9


@given(st.integers(0, 999), st.floats(-1e4, 1e4) | st.floats(-1, 1), st.sampled_from([1.0, 1e7]))
def test_single_wrong_stamp_does_not_affect_the_others(
    where: int, wrong_s: float, tick_hz: float
) -> None:
    stamps, received = arrivals(12, 10.0, offset_s=1.7e6)
    usual, read = Read(), Read()
    usual.feed(stamps * tick_hz, received)
    stamps[where] += wrong_s
    read.feed(stamps * tick_hz, received)
    assert read.notices == usual.notices
    times = {each.item: each.time for each in read.timed}
    # Until the unit of the stamps is known, those before a wrong one are dropped with it.
    assert len(times) >= 999 - (where if where < 210 else 0)
    for each in usual.timed:
        if each.item in times and each.item != where:
            assert times[each.item] == pytest.approx(each.time, abs=1e-3)


def test_frame_numbers_give_no_notice() -> None:
    _, received = arrivals(3, 10.0)
    read = Read(counts=True)
    read.feed(500 + np.arange(1000.0), received)
    assert not read.notices
    assert np.diff(read.times) == pytest.approx(0.01)


def test_unusual_tick_rate_is_measured() -> None:
    sent, received = arrivals(2, 20.0, offset_s=0.0)
    read = Read()
    read.feed(np.round(sent * 3_579_545), received)
    spans = read.times[-1] - read.times[0]
    assert spans == pytest.approx(19.99, rel=1e-3)


def test_constant_stamps_are_replaced_by_arrival_times() -> None:
    _, received = arrivals(4, 5.0)
    read = Read()
    read.feed(np.zeros(500), received)
    assert read.kinds == ["stamps"]
    assert (read.times == received).all()


def test_stamps_may_stall_only_briefly() -> None:
    stamps, received = arrivals(4, 15.0)
    stamps -= stamps[0]
    stamps[500:1000] = 5.0
    read = Read()
    read.feed(stamps[:500], received[:500])
    read.reader.restart()
    read.feed(stamps[500:], received[500:])
    assert read.kinds == ["stamps", "clock"]
    assert (np.diff(read.times) >= 0).all()
    assert read.times[-1] == pytest.approx(stamps[-1], abs=0.01)
    assert len(read.timed) == 1500


@pytest.mark.parametrize("jump_s", [3600.0, -3600.0, 1.0, -1.0, -0.3, 0.05])
def test_clock_step_is_noticed_and_followed(jump_s: float) -> None:
    stamps, received = arrivals(5, 20.0)
    stamps[1000:] += jump_s
    read = Read()
    read.feed(stamps, received)
    assert read.kinds == ["clock"]
    assert ("ahead" if jump_s > 0 else "back") in read.notices[0][1]
    (stated,) = re.findall(r"by ([0-9.e+]+) s", read.notices[0][1])
    assert float(stated) == pytest.approx(abs(jump_s), abs=0.03, rel=0.01)
    late = np.array([each.received - each.time for each in read.timed])
    # The clocks are related as before.
    assert abs(late[-500:].min() - late[:1000].min()) < 1e-3
    assert (np.diff(read.times) > 0).all()


@pytest.mark.parametrize("jump", [100_000, -100_000])
def test_counter_jump_during_detection_is_absorbed(jump: float) -> None:
    _, received = arrivals(11, 10.0)
    frames = 200_000 + np.arange(1000.0)
    frames[100:] += jump
    read = Read(counts=True)
    read.feed(frames, received)
    assert len(read.timed) == 900
    assert np.diff(read.times) == pytest.approx(0.01)


def test_small_backward_clock_step_is_noticed() -> None:
    stamps, received = arrivals(6, 20.0)
    stamps[1000:] -= 0.1
    read = Read()
    read.feed(stamps, received)
    assert read.kinds == ["clock"]
    late = np.array([each.received - each.time for each in read.timed])
    assert abs(late[-500:].min() - late[:1000].min()) < 1e-3


@pytest.mark.parametrize(
    ("silent_s", "step_s"),
    [(3.0, -2.0), (6.0, -5.0), (10.0, -5.0), (3.0, -3.1), (3.0, -3.2), (3.0, -3.24), (1.9, -2.0)],
)
@pytest.mark.parametrize("bodies", [1, 40])
def test_clock_set_back_during_a_silence_misdates_nothing(
    silent_s: float, step_s: float, bodies: int
) -> None:
    stamps, received = arrivals(16, 30.0)
    begin = received[0] + 10.0
    stamps[received > begin] += step_s
    heard = (received < begin) | (received > begin + silent_s)
    read = Read()
    read.feed(np.repeat(stamps[heard], bodies), np.repeat(received[heard], bodies))
    assert read.kinds == ["clock"]
    assert f"jumped back by {-step_s:g}" in read.notices[0][1]
    late = np.array([each.received - each.time for each in read.timed])
    assert np.ptp(late) < 0.3
    assert (np.diff(read.times) >= 0).all()
    assert len(read.timed) == bodies * np.count_nonzero(heard)


@pytest.mark.parametrize("drained_in_s", [0.2, 0.5, 2.0])
def test_what_a_network_held_back_keeps_its_times(drained_in_s: float) -> None:
    stamps, received = arrivals(17, 30.0)
    held = (received > 1010) & (received < 1012.5 + drained_in_s)
    received[held] = np.linspace(1012.5, 1012.5 + drained_in_s, np.count_nonzero(held))
    read = Read()
    read.feed(stamps, received)
    assert not read.notices
    assert (read.times == stamps).all()


def test_network_stall_is_not_a_clock_jump() -> None:
    stamps, received = arrivals(7, 30.0)
    held = (received > 1010) & (received < 1012.5)
    received[held] = 1012.5
    read = Read()
    read.feed(stamps, received)
    assert not read.notices
    assert (read.times == stamps).all()


def test_stamps_of_several_bodies_may_be_slightly_out_of_order() -> None:
    stamps, received = arrivals(8, 10.0)
    disordered = np.column_stack((stamps, stamps - 0.004)).ravel()
    read = Read()
    read.feed(disordered, np.repeat(received, 2))
    assert not read.notices
    assert (read.times == disordered).all()


@pytest.mark.parametrize("counts", [False, True])
def test_many_bodies_with_one_stamp_are_no_clock_jumps(counts: bool) -> None:
    stamps, received = arrivals(13, 10.0)
    if counts:
        stamps = 500 + np.arange(1000.0)
    read = Read(counts=counts)
    read.feed(np.repeat(stamps, 40), np.repeat(received, 40))
    assert not read.notices
    assert len(read.timed) == 40_000


@pytest.mark.parametrize("wrong_s", [-3600.0, -0.5, 0.5, 3600.0])
def test_one_wrong_stamp_of_many_bodies_is_no_clock_jump(wrong_s: float) -> None:
    stamps, received = arrivals(14, 10.0)
    stamps[600] += wrong_s
    read = Read()
    read.feed(np.repeat(stamps, 8), np.repeat(received, 8))
    assert not read.notices
    assert len(read.timed) == 8 * 999


def test_a_clock_step_with_many_bodies_is_noticed_and_followed() -> None:
    stamps, received = arrivals(15, 10.0)
    stamps[500:] += 3600.0
    read = Read()
    read.feed(np.repeat(stamps, 40), np.repeat(received, 40))
    assert read.kinds == ["clock"]
    assert "ahead" in read.notices[0][1]
    assert len(read.timed) == 40_000
    assert (np.diff(read.times) >= 0).all()


def test_reconnecting_to_the_same_clock_gives_no_notice() -> None:
    stamps, received = arrivals(9, 20.0)
    read = Read()
    read.feed(stamps[:800], received[:800])
    read.reader.restart()
    read.feed(stamps[1200:], received[1200:])
    assert not read.notices
    assert (read.times == np.concatenate((stamps[:800], stamps[1200:]))).all()


def test_restarted_server_continues_the_time_line() -> None:
    stamps, received = arrivals(10, 20.0)
    read = Read()
    read.feed(stamps[:800], received[:800])
    read.reader.restart()
    read.feed(stamps[1200:] - stamps[1200], received[1200:])
    assert read.kinds == ["clock"]
    assert "different" in read.notices[0][1]
    assert np.abs(read.times[800:] - stamps[1200:]).max() < 1e-3
