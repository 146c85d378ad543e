"""Playback of a source at its recorded pace: pause, step, seek, rate, loop and restart.

No frame of a source that is not live is ever dropped: if reading or observing cannot keep up,
playback slows down and reports the rate it actually achieves.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

from app.contract.commands import MAX_PLAYBACK_RATE, MIN_PLAYBACK_RATE, SetPlayback
from app.engine.errors import NotNow
from observer.errors import InputError, SourceError
from observer.sources.contract import NoFrame, SeekableSource, SkippedFrame, Source
from observer.types import StereoFrame

_RATE_WINDOW_S = 2.0


@dataclass(frozen=True, eq=False)
class PlayedFrame:
    """Frame that is due.

    Attributes:
        frame: its index and time continue across rewinds; ``received`` is the instant it was played
            (for a live source, received).
        source_time: its time within the source, for looking up truth.
        position: its number within the source.
        new_segment: it follows a rewind, a seek or a new beginning in the recording, so it is
            unrelated to earlier frames.
    """

    frame: StereoFrame
    source_time: float
    position: int
    new_segment: bool


class Player:
    """Player that hands out a source's frames when their time has come.

    Methods that depend on the time take ``now``, the host's monotonic clock. None of them blocks,
    except that reading takes as long as the source takes.

    Attributes:
        paused, rate, loop: the current settings.
        position: number of the frame played last within the source; None before the first.
        skipped: number of frames that could not be read.
        trouble: one sentence on why a live source delivers nothing.
    """

    def __init__(self, source: Source, *, paused: bool, rate: float, loop: bool) -> None:
        self._source = source
        self._seekable = source if isinstance(source, SeekableSource) else None
        self._live = source.info.live
        self._period = 1.0 / source.info.frame_rate
        self.rate = _checked_rate(rate)
        self.loop = loop and not self._live
        self.paused = paused and not self._live
        self._steps = 0
        self._held: PlayedFrame | None = None
        self._ended = False
        self._rewound = False
        self._frames_in_pass = 0
        self._last_index = -1
        self._last_time: float | None = None
        self._index_offset = 0
        # None from a rewind until the first frame after it shows its own time.
        self._time_offset: float | None = 0.0
        # Host instant and the source instant (continued over loops) that corresponds to it.
        self._anchor: tuple[float, float] | None = None
        self._played: deque[tuple[float, float]] = deque()
        self.position: int | None = None
        self.skipped = 0
        self.trouble: str | None = None

    @property
    def seekable(self) -> bool:
        """Return true if playback can continue from any frame."""
        return self._seekable is not None

    @property
    def ended(self) -> bool:
        """Return true once the last frame was played and the source is not looped."""
        return self._ended and self._held is None

    @property
    def next_index(self) -> int:
        """Return the index of the next frame to play, or the best guess before it is read."""
        return self._last_index + 1 if self._held is None else self._held.frame.index

    @property
    def held(self) -> StereoFrame | None:
        """Return the frame that was read and waits for its turn."""
        return None if self._held is None else self._held.frame

    @property
    def held_source_time(self) -> float | None:
        """Return the ``source_time`` of the frame that waits for its turn."""
        return None if self._held is None else self._held.source_time

    def achieved_rate(self, now: float) -> float | None:
        """Return source seconds per second over the last 2 s; None if too little was played."""
        while self._played and self._played[0][0] < now - _RATE_WINDOW_S:
            self._played.popleft()
        if len(self._played) < 3:
            return None
        (start, first), (end, last) = self._played[0], self._played[-1]
        return (last - first) / (end - start) if end > start else None

    def read_ahead(self) -> SkippedFrame | None:
        """Read the next frame ahead; reads the source at most once.

        Returns:
            The frame if it could not be read, else None.

        Raises:
            SourceError: the source holds no readable frame at all; the source's own errors pass
                through.
        """
        if not self.wants_reading:
            return None
        item = self._source.read()
        if isinstance(item, StereoFrame | SkippedFrame):
            self._note_beginning()
        if isinstance(item, SkippedFrame):
            self.skipped += 1
            self._last_index = item.index + self._index_offset
            return replace(item, index=self._last_index)
        if isinstance(item, NoFrame):
            self.trouble = item.trouble
        elif item is not None:
            self.trouble = None
            self._hold(item)
        elif self._frames_in_pass == 0:
            raise SourceError(
                f"{self._source.info.spec} contains no readable frame; give a source with at least "
                "two stereo frames"
            )
        elif self.loop:
            self._rewind()
        else:
            self._ended = True
        return None

    def _note_beginning(self) -> None:
        """Begin a new segment where one began in the recording."""
        if self._seekable is None or self._last_index < 0 or self._seekable.begins is None:
            return
        self._rewound = True
        if self._seekable.begins == "observer" and self._time_offset is not None:
            # The source had been reopened at this point, so its numbers and times were different.
            self._index_offset = self._last_index + 1
            self._time_offset = None

    def _hold(self, frame: StereoFrame) -> None:
        if self._time_offset is None:
            last = self._last_time
            self._time_offset = 0.0 if last is None else last + self._period - frame.time
        self._frames_in_pass += 1
        right_time = None if frame.right_time is None else frame.right_time + self._time_offset
        continued = replace(
            frame,
            index=frame.index + self._index_offset,
            time=frame.time + self._time_offset,
            right_time=right_time,
        )
        # A recording may lack frames, so its indexes do not count them.
        position = frame.index if self._seekable is None else self._seekable.position - 1
        self._held = PlayedFrame(continued, frame.time, position, self._rewound)
        self._rewound = False

    def _rewind(self) -> None:
        self._source.rewind()
        self._begin_anew()

    def _begin_anew(self) -> None:
        self._held = None
        self._ended = False
        self._frames_in_pass = 0
        self._index_offset = self._last_index + 1
        self._time_offset = None
        self._rewound = self._last_index >= 0

    def wait_s(self, now: float) -> float | None:
        """Return the seconds until the held frame's turn, 0 if it has come.

        None if nothing will come without a command or a read.
        """
        if self._held is None:
            return None
        if self._live or self._steps:
            return 0.0
        if self.paused:
            return None
        return max(0.0, self._due(self._held.frame.time, now) - now)

    @property
    def wants_reading(self) -> bool:
        """Return true if ``read_ahead`` would read."""
        return self._held is None and not self._ended

    def _due(self, time: float, now: float) -> float:
        if self._anchor is None:
            self._anchor = (now, time)
        return self._anchor[0] + (time - self._anchor[1]) / self.rate

    def take(self, now: float) -> PlayedFrame:
        """Take the held frame and count it as played."""
        played, self._held = self._held, None
        assert played is not None
        frame = played.frame
        if self._steps:
            self._steps -= 1
        elif not self._live and now - self._due(frame.time, now) > self._period / self.rate:
            # More than a frame late: do not try to catch up; shift the schedule from here on.
            self._anchor = (now, frame.time)
        if not self._live:
            frame = replace(frame, received=now)
        self._last_index, self._last_time = frame.index, frame.time
        self._played.append((now, frame.time))
        self.position = played.position
        return replace(played, frame=frame)

    def change(self, command: SetPlayback) -> None:
        """Change the given settings, all or nothing.

        Raises:
            InputError: a value is out of range, or the source is live or cannot seek.
            NotNow: steps were requested while playing.
            SourceError: the source cannot be rewound.
        """
        step, seek, restart = command.step, command.seek, command.restart
        moved = restart or seek is not None
        changed = command.paused or command.rate not in (None, 1.0) or command.loop or step or moved
        if self._live and changed:
            raise InputError("a live source cannot be paused or replayed")
        rate = self.rate if command.rate is None else _checked_rate(command.rate)
        if step < 0:
            raise InputError(f"step must be a number of frames of at least 0, not {step}")
        paused = self.paused if command.paused is None else command.paused
        if step and not paused:
            raise NotNow("stepping is only possible while paused; pause first")
        if seek is not None:
            self._seek(seek, restart=restart)
        if command.loop is not None:
            self.loop = command.loop
        if restart or (self.loop and self._ended):
            self._rewind()
        if moved or rate != self.rate or paused != self.paused:
            self._anchor = None
            self._played.clear()
        # A user who seeks while paused wants to see that frame.
        shown = step + (seek is not None)
        self._steps = self._steps + shown if paused else 0
        self.rate, self.paused = rate, paused

    def _seek(self, position: int, *, restart: bool) -> None:
        if self._seekable is None:
            raise InputError(
                "only recordings support seeking; this source always plays from its start"
            )
        count = self._source.info.frame_count
        if restart or isinstance(position, bool) or not 0 <= position < (count or 0):
            raise InputError(
                f"seek must be a frame from 0 to {(count or 0) - 1} without restart, not "
                f"{position}{' with restart' if restart else ''}"
            )
        self._seekable.seek(position)
        # The pending steps were meant for other frames.
        self._steps = 0
        self._begin_anew()
        # The source does hold readable frames, even if all from here on are damaged.
        self._frames_in_pass = 1


def _checked_rate(rate: float) -> float:
    if isinstance(rate, bool) or not MIN_PLAYBACK_RATE <= rate <= MAX_PLAYBACK_RATE:
        raise InputError(
            f"rate must be a number from {MIN_PLAYBACK_RATE:g} to {MAX_PLAYBACK_RATE:g}, not {rate}"
        )
    return float(rate)
