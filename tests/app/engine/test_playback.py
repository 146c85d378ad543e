"""Playback against a clock that the test moves."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.engine.errors import NotNow
from app.engine.playback import PlayedFrame, Player
from observer.errors import InputError, SourceError

Numbered = Callable[..., Any]


class Host:
    """Plays as the engine's loop does, on a clock of its own; observing takes ``busy_s``."""

    def __init__(self, player: Player, busy_s: float = 0.0) -> None:
        self.player = player
        self.now = 1000.0
        self.busy_s = busy_s
        self.played: list[tuple[float, PlayedFrame]] = []
        self.skipped: list[int] = []

    def run(self, seconds: float) -> list[PlayedFrame]:
        until, before = self.now + seconds, len(self.played)
        while self.now < until:
            while self.player.wants_reading:
                skipped = self.player.read_ahead()
                if skipped is not None:
                    self.skipped.append(skipped.index)
            wait = self.player.wait_s(self.now)
            if wait is None or self.now + wait >= until:
                self.now = until
                break
            self.now += wait
            self.played.append((self.now, self.player.take(self.now)))
            self.now += self.busy_s
        return [frame for _, frame in self.played[before:]]


def player(source: Any, **changes: Any) -> Player:
    return Player(source, **({"paused": False, "rate": 1.0, "loop": False} | changes))


def test_frames_come_at_the_recorded_pace(numbered: Numbered) -> None:
    host = Host(player(numbered(5)))
    host.run(2.0)
    assert [round(at - 1000.0, 6) for at, _ in host.played] == [0.0, 0.1, 0.2, 0.3, 0.4]
    assert [p.frame.index for _, p in host.played] == [0, 1, 2, 3, 4]
    assert all(p.frame.received == at for at, p in host.played)
    assert host.player.ended


@pytest.mark.parametrize("rate", [0.1, 0.5, 2.0, 4.0])
def test_the_rate_scales_the_pace(numbered: Numbered, rate: float) -> None:
    host = Host(player(numbered(30), rate=rate))
    host.run(1.0 / rate)
    # The frame at exactly the end may or may not be counted in.
    assert len(host.played) in (10, 11)
    assert host.played[9][0] - host.played[0][0] == pytest.approx(0.9 / rate)


def test_a_changed_rate_acts_from_the_next_frame_on(numbered: Numbered) -> None:
    host = Host(player(numbered(100)))
    host.run(0.95)
    host.player.change(rate=4.0)
    host.run(0.5)
    later = [at for at, _ in host.played][-5:]
    assert [b - a for a, b in itertools.pairwise(later)] == pytest.approx([0.025] * 4)


def test_pause_holds_and_resuming_neither_hurries_nor_skips(numbered: Numbered) -> None:
    host = Host(player(numbered(10)))
    host.run(0.25)
    host.player.change(paused=True)
    assert host.run(5.0) == []
    host.player.change(paused=False)
    resumed = host.run(0.35)
    assert [p.frame.index for p in resumed] == [3, 4, 5, 6]
    times = [at for at, _ in host.played][3:]
    assert [b - a for a, b in itertools.pairwise(times)] == pytest.approx([0.1] * 3)


def test_steps_show_just_so_many_frames(numbered: Numbered) -> None:
    host = Host(player(numbered(10), paused=True))
    assert host.run(1.0) == []
    host.player.change(step=2)
    host.player.change(step=1)
    assert [p.position for p in host.run(1.0)] == [0, 1, 2]
    assert host.run(1.0) == []
    with pytest.raises(NotNow, match="pause first"):
        host.player.change(paused=False, step=1)
    assert host.player.paused, "a refused change must change nothing"


def test_looping_continues_time_and_index_in_a_new_segment(numbered: Numbered) -> None:
    host = Host(player(numbered(3), loop=True))
    host.run(1.0)
    frames = [p for _, p in host.played][:9]
    assert [p.frame.index for p in frames] == list(range(9))
    assert [p.frame.time for p in frames] == pytest.approx([100 + k / 10 for k in range(9)])
    assert [p.source_time for p in frames] == pytest.approx([100, 100.1, 100.2] * 3)
    assert [p.position for p in frames] == [0, 1, 2] * 3
    assert [p.new_segment for p in frames] == [
        False,
        False,
        False,
        True,
        False,
        False,
        True,
        False,
        False,
    ]
    assert [round(at - 1000, 6) for at, _ in host.played][:9] == [k / 10 for k in range(9)]


def test_restart_begins_anew_with_time_going_on(numbered: Numbered) -> None:
    host = Host(player(numbered(10)))
    host.run(0.35)
    host.player.change(restart=True)
    again = host.run(0.15)
    assert [p.position for p in again] == [0, 1]
    assert [p.frame.index for p in again] == [4, 5]
    assert again[0].frame.time == pytest.approx(100.4)
    assert [p.new_segment for p in again] == [True, False]


def test_an_ended_source_goes_on_when_looped_or_restarted(numbered: Numbered) -> None:
    host = Host(player(numbered(2)))
    host.run(1.0)
    assert host.player.ended
    host.player.change(loop=True)
    assert not host.player.ended
    assert [p.position for p in host.run(0.15)] == [0, 1]
    host.player.change(loop=False)
    host.run(1.0)
    assert host.player.ended
    host.player.change(restart=True)
    assert [p.position for p in host.run(1.0)] == [0, 1]


def test_a_slow_observer_slows_playback_and_loses_nothing(numbered: Numbered) -> None:
    host = Host(player(numbered(60)), busy_s=0.25)
    host.run(5.0)
    assert [p.frame.index for _, p in host.played] == list(range(20))
    assert host.player.achieved_rate(host.now) == pytest.approx(0.4, rel=0.05)
    host.busy_s = 0.0
    host.run(1.0)
    times = [at for at, _ in host.played][-8:]
    assert [b - a for a, b in itertools.pairwise(times)] == pytest.approx([0.1] * 7), (
        "what was late is not caught up by a rush of frames"
    )


def test_a_single_late_frame_is_made_up_for(numbered: Numbered) -> None:
    host = Host(player(numbered(20)))
    host.run(0.45)
    host.now += 0.09
    host.run(0.5)
    assert host.played[-1][0] - 1000 == pytest.approx(0.1 * host.played[-1][1].frame.index)


def test_the_achieved_rate_is_unknown_until_there_is_something_to_measure(
    numbered: Numbered,
) -> None:
    host = Host(player(numbered(50)))
    assert host.player.achieved_rate(host.now) is None
    host.run(1.0)
    assert host.player.achieved_rate(host.now) == pytest.approx(1.0)
    host.player.change(paused=True)
    assert host.player.achieved_rate(host.now) is None


def test_unreadable_frames_are_reported_and_leave_a_gap(numbered: Numbered) -> None:
    host = Host(player(numbered(4, broken={0, 2}), loop=True))
    host.run(0.75)
    assert [p.frame.index for _, p in host.played][:4] == [1, 3, 5, 7]
    assert host.skipped[:4] == [0, 2, 4, 6]
    assert host.player.skipped == len(host.skipped)


@pytest.mark.parametrize("loop", [True, False])
@pytest.mark.parametrize(("count", "broken"), [(0, ()), (3, {0, 1, 2})])
def test_a_source_without_any_frame_is_refused(
    numbered: Numbered, loop: bool, count: int, broken: Any
) -> None:
    with pytest.raises(SourceError, match="no frame that can be read"):
        Host(player(numbered(count, broken=broken), loop=loop)).run(1.0)


def test_a_live_source_is_neither_held_nor_restamped(numbered: Numbered) -> None:
    live = player(numbered(3, live=True), paused=True)
    live.read_ahead()
    assert live.wait_s(5.0) == 0.0
    assert live.take(5.0).frame.received == -1.0
    for change in ({"paused": True}, {"rate": 2.0}, {"step": 1}, {"restart": True}):
        with pytest.raises(InputError, match="own pace"):
            live.change(**change)


@pytest.mark.parametrize("rate", [0.0, 0.09, 4.1, -1.0, float("nan"), float("inf"), True])
def test_rates_out_of_range_change_nothing(numbered: Numbered, rate: float) -> None:
    playing = player(numbered(3))
    with pytest.raises(InputError, match=r"from 0.1 to 4"):
        playing.change(rate=rate, paused=True)
    assert (playing.rate, playing.paused) == (1.0, False)


@settings(deadline=None, max_examples=40)
@given(
    commands=st.lists(
        st.tuples(
            st.sampled_from(["pause", "resume", "step", "restart", "loop", "faster", "slower"]),
            st.floats(0.0, 0.7),
        ),
        max_size=12,
    )
)
def test_whatever_is_pressed_time_and_index_only_go_forward(
    numbered: Numbered, commands: list[tuple[str, float]]
) -> None:
    host = Host(player(numbered(4, broken={2}), loop=True))
    for name, seconds in commands:
        playing = host.player
        match name:
            case "pause":
                playing.change(paused=True)
            case "resume":
                playing.change(paused=False)
            case "step":
                playing.change(paused=True, step=1)
            case "restart":
                playing.change(restart=True)
            case "loop":
                playing.change(loop=not playing.loop)
            case "faster":
                playing.change(rate=4.0)
            case "slower":
                playing.change(rate=0.5)
        host.run(seconds)
    frames = [p.frame for _, p in host.played]
    assert all(b.index > a.index and b.time > a.time for a, b in itertools.pairwise(frames))
    assert all(p.source_time == pytest.approx(100 + p.position / 10) for _, p in host.played)
