"""Playback against a clock that the test controls."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import Any, ClassVar

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.contract.commands import SetPlayback
from app.engine.errors import NotNow
from app.engine.playback import PlayedFrame, Player
from observer.errors import InputError, SourceError
from observer.sources.contract import SkippedFrame

Numbered = Callable[..., Any]


class Host:
    """Plays like the engine's loop, on a clock of its own; observing takes ``busy_s``."""

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


def test_frames_play_at_the_recorded_pace(numbered: Numbered) -> None:
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
    # The frame exactly at the end may or may not be included.
    assert len(host.played) in (10, 11)
    assert host.played[9][0] - host.played[0][0] == pytest.approx(0.9 / rate)


def test_a_changed_rate_applies_from_the_next_frame(numbered: Numbered) -> None:
    host = Host(player(numbered(100)))
    host.run(0.95)
    host.player.change(SetPlayback(rate=4.0))
    host.run(0.5)
    later = [at for at, _ in host.played][-5:]
    assert [b - a for a, b in itertools.pairwise(later)] == pytest.approx([0.025] * 4)


def test_resuming_after_a_pause_neither_rushes_nor_skips(numbered: Numbered) -> None:
    host = Host(player(numbered(10)))
    host.run(0.25)
    host.player.change(SetPlayback(paused=True))
    assert host.run(5.0) == []
    host.player.change(SetPlayback(paused=False))
    resumed = host.run(0.35)
    assert [p.frame.index for p in resumed] == [3, 4, 5, 6]
    times = [at for at, _ in host.played][3:]
    assert [b - a for a, b in itertools.pairwise(times)] == pytest.approx([0.1] * 3)


def test_steps_show_exactly_as_many_frames(numbered: Numbered) -> None:
    host = Host(player(numbered(10), paused=True))
    assert host.run(1.0) == []
    host.player.change(SetPlayback(step=2))
    host.player.change(SetPlayback(step=1))
    assert [p.position for p in host.run(1.0)] == [0, 1, 2]
    assert host.run(1.0) == []
    with pytest.raises(NotNow, match="pause first"):
        host.player.change(SetPlayback(paused=False, step=1))
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


def test_restart_returns_to_the_start_while_time_continues(numbered: Numbered) -> None:
    host = Host(player(numbered(10)))
    host.run(0.35)
    host.player.change(SetPlayback(restart=True))
    again = host.run(0.15)
    assert [p.position for p in again] == [0, 1]
    assert [p.frame.index for p in again] == [4, 5]
    assert again[0].frame.time == pytest.approx(100.4)
    assert [p.new_segment for p in again] == [True, False]


def test_an_ended_source_continues_when_looped_or_restarted(numbered: Numbered) -> None:
    host = Host(player(numbered(2)))
    host.run(1.0)
    assert host.player.ended
    host.player.change(SetPlayback(loop=True))
    assert not host.player.ended
    assert [p.position for p in host.run(0.15)] == [0, 1]
    host.player.change(SetPlayback(loop=False))
    host.run(1.0)
    assert host.player.ended
    host.player.change(SetPlayback(restart=True))
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


def test_a_single_late_frame_is_caught_up(numbered: Numbered) -> None:
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
    host.player.change(SetPlayback(paused=True))
    assert host.player.achieved_rate(host.now) is None


def test_unreadable_frames_are_reported_and_leave_a_gap(numbered: Numbered) -> None:
    host = Host(player(numbered(4, broken={0, 2}), loop=True))
    host.run(0.75)
    assert [p.frame.index for _, p in host.played][:4] == [1, 3, 5, 7]
    assert host.skipped[:4] == [0, 2, 4, 6]
    assert host.player.skipped == len(host.skipped)


@pytest.mark.parametrize("loop", [True, False])
@pytest.mark.parametrize(("count", "broken"), [(0, ()), (3, {0, 1, 2})])
def test_a_source_without_readable_frames_is_refused(
    numbered: Numbered, loop: bool, count: int, broken: Any
) -> None:
    with pytest.raises(SourceError, match="contains no readable frame"):
        Host(player(numbered(count, broken=broken), loop=loop)).run(1.0)


def test_a_live_source_is_neither_paused_nor_restamped(numbered: Numbered) -> None:
    live = player(numbered(3, live=True), paused=True)
    live.read_ahead()
    assert live.wait_s(5.0) == 0.0
    assert live.take(5.0).frame.received == -1.0
    for change in ({"paused": True}, {"rate": 2.0}, {"step": 1}, {"restart": True}):
        with pytest.raises(InputError, match="cannot be paused"):
            live.change(SetPlayback(**change))


@pytest.mark.parametrize("rate", [0.0, 0.09, 4.1, -1.0, float("nan"), float("inf"), True])
def test_rates_out_of_range_change_nothing(numbered: Numbered, rate: float) -> None:
    playing = player(numbered(3))
    with pytest.raises(InputError, match=r"from 0.1 to 4"):
        playing.change(SetPlayback(rate=rate, paused=True))
    assert (playing.rate, playing.paused) == (1.0, False)


@settings(max_examples=40)
@given(
    commands=st.lists(
        st.tuples(
            st.sampled_from(["pause", "resume", "step", "restart", "loop", "faster", "slower"]),
            st.floats(0.0, 0.7),
        ),
        max_size=12,
    )
)
def test_time_and_index_only_increase_for_any_commands(
    numbered: Numbered, commands: list[tuple[str, float]]
) -> None:
    host = Host(player(numbered(4, broken={2}), loop=True))
    for name, seconds in commands:
        playing = host.player
        match name:
            case "pause":
                playing.change(SetPlayback(paused=True))
            case "resume":
                playing.change(SetPlayback(paused=False))
            case "step":
                playing.change(SetPlayback(paused=True, step=1))
            case "restart":
                playing.change(SetPlayback(restart=True))
            case "loop":
                playing.change(SetPlayback(loop=not playing.loop))
            case "faster":
                playing.change(SetPlayback(rate=4.0))
            case "slower":
                playing.change(SetPlayback(rate=0.5))
        host.run(seconds)
    frames = [p.frame for _, p in host.played]
    assert all(b.index > a.index and b.time > a.time for a, b in itertools.pairwise(frames))
    assert all(p.source_time == pytest.approx(100 + p.position / 10) for _, p in host.played)


class Recorded:
    """A recording of numbered frames: frame 3 began a segment, frame 6 a second engine's run."""

    starts: ClassVar[dict[int, str]] = {0: "observer", 3: "segment", 6: "observer"}

    def __init__(self, numbered: Numbered, broken: tuple[int, ...] = ()) -> None:
        self._source = numbered(10)
        self._broken = broken
        self.info, self.calibration = self._source.info, self._source.calibration
        self.begins: Any = None

    @property
    def position(self) -> int:
        at: int = self._source.at
        return at

    def read(self) -> Any:
        at = self.position
        frame = self._source.read()
        if frame is None:
            return None
        self.begins = self.starts.get(at)
        if at in self._broken:
            return SkippedFrame(at, "its images are lost")
        if at < 6:
            return frame
        # The second engine opened its source from the beginning.
        return replace(frame, index=at - 6, time=frame.time - 0.6)

    def seek(self, position: int) -> None:
        self._source.at = position

    def rewind(self) -> None:
        self._source.at = 0

    def close(self) -> None:
        pass


def positions(frames: list[PlayedFrame]) -> list[int]:
    return [played.position for played in frames]


def test_a_recording_starts_segments_where_they_were_recorded(numbered: Numbered) -> None:
    frames = Host(player(Recorded(numbered))).run(5.0)
    assert positions(frames) == list(range(10))
    assert [played.position for played in frames if played.new_segment] == [3, 6]
    assert [played.frame.index for played in frames] == list(range(10))
    steps = [b.frame.time - a.frame.time for a, b in itertools.pairwise(frames)]
    assert steps == pytest.approx([0.1] * 9)
    # Ground truth is looked up by the frame's original time.
    assert frames[6].source_time == pytest.approx(100.0)


def test_a_recording_can_be_played_from_any_frame(numbered: Numbered) -> None:
    host = Host(player(Recorded(numbered)))
    assert positions(host.run(0.25)) == [0, 1, 2]
    host.player.change(SetPlayback(seek=8))
    frames = host.run(5.0)
    assert positions(frames) == [8, 9]
    assert [played.new_segment for played in frames] == [True, False]
    host.player.change(SetPlayback(seek=1))
    again = host.run(0.15)
    assert positions(again) == [1, 2]
    seen = [played.frame for _, played in host.played]
    assert all(b.index > a.index and b.time > a.time for a, b in itertools.pairwise(seen))


def test_seeking_while_paused_shows_that_frame(numbered: Numbered) -> None:
    host = Host(player(Recorded(numbered), paused=True))
    host.run(0.1)
    for sought in (4, 2, 9):
        host.player.change(SetPlayback(seek=sought))
        assert positions(host.run(1.0)) == [sought]
    assert host.player.paused
    host.player.change(SetPlayback(seek=0, step=2))
    assert positions(host.run(1.0)) == [0, 1, 2]


def test_damaged_frames_after_a_seek_are_skipped(numbered: Numbered) -> None:
    host = Host(player(Recorded(numbered, broken=(8, 9))))
    host.run(0.1)
    host.player.change(SetPlayback(seek=8))
    host.run(1.0)
    assert host.player.ended
    # If the first frame of a segment is skipped, the next one begins it.
    host = Host(player(Recorded(numbered, broken=(3,))))
    assert [p.position for p in host.run(5.0) if p.new_segment] == [4, 6]


@pytest.mark.parametrize("change", [{"seek": 10}, {"seek": -1}, {"seek": 2, "restart": True}])
def test_an_invalid_seek_changes_nothing(numbered: Numbered, change: Any) -> None:
    host = Host(player(Recorded(numbered)))
    host.run(0.15)
    with pytest.raises(InputError, match="seek must be a frame from 0 to 9"):
        host.player.change(SetPlayback(rate=4.0, **change))
    assert host.player.rate == 1.0
    assert positions(host.run(0.1)) == [2]


def test_only_a_recording_is_seekable(numbered: Numbered) -> None:
    plain = player(numbered(5))
    assert not plain.seekable
    with pytest.raises(InputError, match="only recordings"):
        plain.change(SetPlayback(seek=1))
