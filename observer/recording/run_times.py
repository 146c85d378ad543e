"""Contents of a recording on its run's clock instead of its source's."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Sequence

import msgspec

from observer.jsonl import ObservationLine, OutlinedEntry
from observer.recording.payloads import MatchedTruth, RecordedFrame, RobotRow
from observer.recording.run_time import RunTime


class RunTimes:
    """Times of a recording within its run; they differ only where an engine was replaced.

    Args:
        frames: of the recording, in order.

    Attributes:
        span: first and last time of the run, None without a frame.
        frames: number and time within the run of each frame; each pair is unique.
    """

    def __init__(self, frames: Sequence[RecordedFrame]) -> None:
        clock = RunTime()
        self._frames = frames
        self._offsets = [clock.add_recorded(frame) - frame.time for frame in frames]
        self._same = not any(self._offsets)
        self.frames = tuple(
            (frame.index, frame.time + offset)
            for frame, offset in zip(frames, self._offsets, strict=True)
        )
        self.span: tuple[float, float] | None = None
        if clock.begin_s is not None and clock.duration_s is not None:
            self.span = clock.begin_s, clock.begin_s + clock.duration_s

    def lines(self, lines: Iterable[ObservationLine]) -> tuple[ObservationLine, ...]:
        """Return observations of these frames, in order."""
        if self._same:
            return tuple(lines)
        found: list[ObservationLine] = []
        after = _Offsets(self._frames, self._offsets)
        for line in lines:
            offset = after.of(line["frame"], line["time"])
            obstacles: list[OutlinedEntry] = [
                {**entry, "velocity_time": entry["velocity_time"] + offset}
                for entry in line["obstacles"]
            ]
            found.append({**line, "time": line["time"] + offset, "obstacles": obstacles})
        return tuple(found)

    def matched(self, matched: Iterable[MatchedTruth]) -> tuple[MatchedTruth, ...]:
        """Return true bodies beside these frames, in order."""
        if self._same:
            return tuple(matched)
        after = _Offsets(self._frames, self._offsets)
        return tuple(
            msgspec.structs.replace(each, time=each.time + after.of(each.frame, each.time))
            for each in matched
        )

    def robots(self, rows: Iterable[RobotRow]) -> tuple[RobotRow, ...]:
        """Return robots' rows; a time before the first frame or after the last one is unknown."""
        return tuple(msgspec.structs.replace(row, time=self._robot_time(row)) for row in rows)

    def _robot_time(self, row: RobotRow) -> float | None:
        if row.time is None or self.span is None:
            return None
        at = bisect_right(self._frames, row.received, key=lambda frame: frame.received) - 1
        time = row.time + self._offsets[max(at, 0)]
        return time if self.span[0] <= time <= self.span[1] else None


class _Offsets:
    """Offsets of the run's clock by frame; frames are asked for in order."""

    def __init__(self, frames: Sequence[RecordedFrame], offsets: Sequence[float]) -> None:
        self._frames, self._offsets = frames, offsets
        self._at = 0

    def of(self, frame: int, time: float) -> float:
        """Return the offset at a frame, or that of the frame before if there is no such frame."""
        for at in range(self._at, len(self._frames)):
            if (self._frames[at].index, self._frames[at].time) == (frame, time):
                self._at = at
                break
        return self._offsets[self._at]
