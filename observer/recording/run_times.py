"""Contents of a recording on its run's clock instead of its source's."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Iterable, Sequence

import msgspec

from observer.geometry import Pose
from observer.jsonl import ObservationLine, OutlinedEntry
from observer.recording.payloads import MatchedTruth, RecordedFrame, RobotRow
from observer.recording.run_time import RunTime
from observer.truth.contract import TrueBody, Truth


class RunTimes:
    """Times of a recording within its run; they differ only where an engine was replaced.

    Args:
        frames: of the recording, in order.

    Attributes:
        span: first and last time of the run, None without a frame.
        frames: number and time within the run of each frame; each pair is unique.
        offsets: the run's clock minus the source's at each frame, seconds.
    """

    def __init__(self, frames: Sequence[RecordedFrame]) -> None:
        clock = RunTime()
        self._frames = frames
        self.offsets = tuple(clock.add_recorded(frame) - frame.time for frame in frames)
        self._same = not any(self.offsets)
        self.frames = tuple(
            (frame.index, frame.time + offset)
            for frame, offset in zip(frames, self.offsets, strict=True)
        )
        self.span: tuple[float, float] | None = None
        if clock.begin_s is not None and clock.duration_s is not None:
            self.span = clock.begin_s, clock.begin_s + clock.duration_s

    def lines(self, lines: Iterable[ObservationLine]) -> tuple[ObservationLine, ...]:
        """Return observations of these frames, in order."""
        if self._same:
            return tuple(lines)
        found: list[ObservationLine] = []
        after = _Offsets(self._frames, self.offsets)
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
        after = _Offsets(self._frames, self.offsets)
        return tuple(
            msgspec.structs.replace(each, time=each.time + after.of(each.frame, each.time))
            for each in matched
        )

    def truth(self, truths: Iterable[tuple[int, Truth | None]]) -> Truth | None:
        """Return ground truth on the run's clock; None if there is none at all.

        Args:
            truths: on the source's clock, each with the position of the first frame that it applies
                to, in order.
        """
        truths = tuple(truths)
        if all(truth is None for _, truth in truths):
            return None
        if self._same and len(truths) == 1:
            return truths[0][1]
        return _RunTruth(self._frames, self.offsets, truths)

    def robots(self, rows: Iterable[RobotRow]) -> tuple[RobotRow, ...]:
        """Return robots' rows; a time before the first frame or after the last one is unknown."""
        return tuple(msgspec.structs.replace(row, time=self._robot_time(row)) for row in rows)

    def _robot_time(self, row: RobotRow) -> float | None:
        if row.time is None or self.span is None:
            return None
        at = bisect_right(self._frames, row.received, key=lambda frame: frame.received) - 1
        time = row.time + self.offsets[max(at, 0)]
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


class _RunTruth:
    """Ground truth on the run's clock; fulfils ``observer.truth.contract.Truth``."""

    def __init__(
        self,
        frames: Sequence[RecordedFrame],
        offsets: Sequence[float],
        truths: Sequence[tuple[int, Truth | None]],
    ) -> None:
        # Instants from which another truth or offset applies.
        self._begins: list[float] = []
        self._parts: list[tuple[Truth | None, float]] = []
        # To the last digit, so that a sample is found at its own instant.
        self._source_times: dict[float, float] = {}
        due = deque(truths)
        truth: Truth | None = None
        for position, (frame, offset) in enumerate(zip(frames, offsets, strict=True)):
            while due and due[0][0] <= position:
                _, truth = due.popleft()
            self._source_times[frame.time + offset] = frame.time
            if not self._parts or self._parts[-1] != (truth, offset):
                self._begins.append(frame.time + offset)
                self._parts.append((truth, offset))

    def bodies(self, time: float) -> tuple[TrueBody, ...]:
        truth, at = self._at(time)
        return () if truth is None else truth.bodies(at)

    def camera_pose(self, time: float) -> Pose | None:
        truth, at = self._at(time)
        return None if truth is None else truth.camera_pose(at)

    def _at(self, time: float) -> tuple[Truth | None, float]:
        """Return the truth that applies at an instant, and the instant on its clock."""
        if not self._parts:
            return None, time
        truth, offset = self._parts[max(bisect_right(self._begins, time) - 1, 0)]
        return truth, self._source_times.get(time, time - offset)
