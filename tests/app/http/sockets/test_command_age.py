"""The age of commands over simulated links: two clocks, delays, and a stalled event loop."""

from __future__ import annotations

import math
import random
from collections.abc import Callable

import pytest

from app.contract.drive import COMMAND_FRESH_S
from app.http.sockets.command_age import CommandAge


class Wire:
    """A client whose clock runs on its own, and a link with a delay in each direction.

    ``up`` and ``down`` give the delay of a message sent at a host's time, seconds.
    """

    def __init__(
        self,
        *,
        up: Callable[[float], float] = lambda _: 0.002,
        down: Callable[[float], float] = lambda _: 0.002,
        offset: float = -1234.5,
        drift: float = 0.0,
    ) -> None:
        self.link = CommandAge()
        self.up, self.down, self.offset, self.drift = up, down, offset, drift
        self._pings = 0

    def stamp(self, at: float) -> float:
        """Return the client's clock at a host's time."""
        return (at + self.offset) * (1 + self.drift)

    def ping(self, at: float) -> float:
        """Send one ping and its answer; return when the answer arrives."""
        self._pings += 1
        self.link.pinged(self._pings, at)
        there = at + self.down(at)
        back = there + self.up(there)
        self.link.ponged(self._pings, self.stamp(there), back)
        return back

    def settle(self, until: float) -> None:
        """Ping five times a second for two seconds."""
        for number in range(10):
            self.ping(until - 2.0 + 0.2 * number)

    def send(self, at: float) -> tuple[float, float]:
        """Send a command at a host's time; return its real and its measured age on arrival."""
        arrival = at + self.up(at)
        age = self.link.age(self.stamp(at), arrival)
        assert age is not None
        return arrival - at, age


@pytest.mark.parametrize("drift", [-1e-4, 0.0, 1e-4])
@pytest.mark.parametrize("offset", [-1e6, 0.0, 5e5])
def test_ages_stay_accurate_for_an_hour_with_any_clock_offset(offset: float, drift: float) -> None:
    wire = Wire(offset=offset, drift=drift)
    for step in range(5 * 3600):
        at = 100.0 + 0.2 * step
        wire.ping(at)
        if step % 500 == 499:
            real, age = wire.send(at + 0.05)
            # The delay of the quickest ping on its way adds 2 ms, clock drift between pings 0.1 ms.
            assert real <= age <= real + 0.0021
    state = wire.link.state(at + 0.1)
    assert state.quality == "good"
    assert state.rtt_s == pytest.approx(0.004, abs=1e-6)


@pytest.mark.parametrize(("most_up", "most_down"), [(0.02, 0.02), (0.2, 0.05), (0.05, 0.2)])
def test_jitter_counts_as_age(most_up: float, most_down: float) -> None:
    rng = random.Random(7)
    wire = Wire(
        up=lambda _: 0.001 + rng.random() * most_up,
        down=lambda _: 0.001 + rng.random() * most_down,
    )
    for step in range(600):
        at = 10.0 + 0.2 * step
        wire.ping(at)
        if step > 10:
            real, age = wire.send(at + 0.1)
            # The fastest of fifty pings is close to the minimum delay.
            assert real <= age <= real + 0.03


@pytest.mark.parametrize(("up_s", "down_s"), [(0.24, 0.005), (0.005, 0.24), (0.1, 0.1)])
@pytest.mark.parametrize("drift", [-1e-4, 0.0, 1e-4])
def test_a_command_never_seems_younger_than_it_is(up_s: float, down_s: float, drift: float) -> None:
    wire = Wire(up=lambda _: up_s, down=lambda _: down_s, drift=drift)
    wire.settle(100.0)
    real, age = wire.send(100.1)
    assert real - 1e-9 <= age <= real + down_s + 0.001
    # Nor after the pings have not been answered for a while.
    real, age = wire.send(109.0)
    assert real - 1e-9 <= age <= real + down_s + 0.002


@pytest.mark.parametrize(("each_way_s", "quality"), [(0.07, "good"), (0.09, "slow")])
def test_a_link_is_slow_if_a_command_expires_before_the_next_arrives(
    each_way_s: float, quality: str
) -> None:
    wire = Wire(up=lambda _: each_way_s, down=lambda _: each_way_s)
    wire.settle(100.0)
    assert wire.link.state(100.0 + 2 * each_way_s).quality == quality


def test_a_link_that_becomes_slow_is_reported_and_never_becomes_normal() -> None:
    """A network queue grows to 0.4 s and stays: no window makes its messages fresh again."""
    wire = Wire(up=lambda at: 0.003 if at < 100 else 0.4)
    for step in range(600):
        at = 50.0 + 0.2 * step
        arrival = wire.ping(at)
        real, age = wire.send(at + 0.05)
        now = at + 0.05 + real
        fit = age <= COMMAND_FRESH_S and wire.link.is_fit(max(now, arrival))
        if at < 99:
            assert fit
            assert wire.link.state(now).quality == "good"
        elif at > 100.5:
            assert not fit, at
            assert wire.link.state(max(now, arrival)).quality == "slow"


def test_commands_queued_during_a_stall_have_their_real_age() -> None:
    """Two seconds of commands are read within a millisecond: only the last ones are fresh."""
    wire = Wire()
    wire.settle(100.0)
    stood_until = 102.0
    for number in range(20):
        given = 100.0 + 0.1 * number
        age = wire.link.age(wire.stamp(given), stood_until + 1e-5 * number)
        assert age is not None
        assert age == pytest.approx(stood_until - given, abs=0.005)
        assert (age <= COMMAND_FRESH_S) == (number > 17)
    # Without an answered ping since then, not even those are used.
    assert not wire.link.is_fit(stood_until)


@pytest.mark.parametrize("stood_s", [2.0, 9.9, 10.1, 60.0])
def test_old_commands_never_become_fresh_after_a_stall(stood_s: float) -> None:
    wire = Wire()
    wire.settle(100.0)
    wire.link.pinged(99, 100.0)
    until = 100.0 + stood_s
    for number in range(int(stood_s * 10)):
        given = 100.0 + 0.1 * number
        if number == 3:
            # The answer to the last ping waited in the same queue.
            wire.link.ponged(99, wire.stamp(100.002), until)
        age = wire.link.age(wire.stamp(given), until)
        if until - given > COMMAND_FRESH_S:
            fresh = age is not None and age <= COMMAND_FRESH_S and wire.link.is_fit(until)
            assert not fresh, given


def test_age_is_unknown_before_the_first_pong() -> None:
    wire = Wire()
    assert wire.link.age(wire.stamp(10.0), 10.002) is None
    assert wire.link.state(10.0).quality == "lost"
    wire.link.pinged(1, 10.1)
    # The answer to a ping that was never sent is ignored.
    wire.link.ponged(2, wire.stamp(10.1), 10.104)
    assert wire.link.age(wire.stamp(10.2), 10.202) is None
    wire.link.ponged(1, wire.stamp(10.102), 10.204)
    assert wire.link.age(wire.stamp(10.3), 10.302) is not None
    # A second answer to the same ping is ignored.
    wire.link.ponged(1, wire.stamp(10.4), 10.404)
    assert wire.link.state(10.5).rtt_s == pytest.approx(0.104)


@pytest.mark.parametrize("ahead_s", [0.01, 0.2, 10.0, 1e12, math.inf, math.nan])
def test_a_future_timestamp_gives_no_age_and_corrupts_no_others(ahead_s: float) -> None:
    wire = Wire()
    wire.settle(50.0)
    assert wire.link.age(wire.stamp(50.0) + ahead_s, 50.002) is None
    wire.link.pinged(100, 50.0)
    wire.link.ponged(100, wire.stamp(50.0) + ahead_s, 50.004)
    real, age = wire.send(50.1)
    # If it cannot be distinguished from a faster link, commands seem older, never fresher.
    assert real <= age <= real + 0.011


def test_a_replayed_command_ages_from_its_first_sending() -> None:
    wire = Wire()
    wire.settle(50.0)
    stamp = wire.stamp(50.0)
    ages = [wire.link.age(stamp, 50.002 + 0.1 * again) for again in range(5)]
    assert ages == pytest.approx([0.004 + 0.1 * again for again in range(5)], abs=0.001)


def test_silence_means_lost_and_a_late_command_marks_the_link_slow() -> None:
    wire = Wire()
    wire.settle(50.0)
    assert wire.link.state(49.9).quality == "good"
    wire.link.age(wire.stamp(49.6), 49.95)
    state = wire.link.state(50.0)
    assert state.quality == "slow"
    assert state.delay_s == pytest.approx(0.35, abs=0.005)
    # Commands that arrive in time are still used.
    assert wire.link.is_fit(50.0)
    for number in range(5):
        wire.ping(50.1 + 0.2 * number)
    assert wire.link.state(51.0).quality == "good"
    assert wire.link.state(52.0).quality == "lost"
    assert not wire.link.is_fit(52.0)
    assert wire.link.state(70.0).rtt_s is None


def test_memory_is_bounded() -> None:
    link = CommandAge()
    for number in range(10_000):
        link.pinged(number, 0.01 * number)
    # The oldest pings are forgotten: their answers are ignored.
    link.ponged(0, 0.0, 100.0)
    assert link.state(100.0).rtt_s is None
