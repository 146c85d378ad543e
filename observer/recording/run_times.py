"""Contents of a recording on its run's clock instead of its source's."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TypeVar

import msgspec

from observer.geometry import Pose
from observer.jsonl import ObservationLine, OutlinedEntry
from observer.recording.payloads import MatchedTruth, RecordedFrame, RobotRow
from observer.recording.run_time import RunTime
from observer.truth.contract import TrueBody, Truth

_Item = TypeVar("_Item")


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
        for line, offset in self._with_offsets(lines, lambda line: (line["frame"], line["time"])):
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
        return tuple(
            msgspec.structs.replace(each, time=each.time + offset)
            for each, offset in self._with_offsets(matched, lambda each: (each.frame, each.time))
        )

    def _with_offsets(
        self, items: Iterable[_Item], of: Callable[[_Item], tuple[int, float]]
    ) -> Iterator[tuple[_Item, float]]:
        """Yield each item with the run's clock minus the source's at its frame, or near it."""
        places = FramePlaces(self._frames)
        for item in items:
            at = places.of(*of(item))
            yield item, self.offsets[places.near if at is None else at]

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


class FramePlaces:
    """Finds the positions of a recording's frames by number and time, asked for in order.

    Both repeat where an engine was replaced. There the time steps back, unless the source's clock
    goes on, and then no time repeats.

    Args:
        frames: of the recording, in order.

    Attributes:
        near: position found last, or of the first frame of a later part that must have begun since.
    """

    def __init__(self, frames: Sequence[RecordedFrame]) -> None:
        self.near = 0
        # By part: its frames, and the time of the last one.
        self._parts: list[tuple[dict[tuple[int, float], int], float]] = []
        self._part = 0
        # Whether the clock's step back led to this part, or a line whose frame is missing.
        self._stepped = True
        self._newest = -math.inf
        for position, frame in enumerate(frames):
            places, last = self._parts[-1] if self._parts else ({}, math.inf)
            key = frame.index, frame.time
            if frame.begins == "observer" or frame.time < last or key in places:
                places = {}
                self._parts.append((places, frame.time))
            places[key] = position
            self._parts[-1] = places, frame.time

    def of(self, frame: int, time: float) -> int | None:
        """Return the position of a frame, or None if it is missing, as in a damaged file."""
        steps = time < self._newest
        # A missing frame is found in the next part if that repeats its number and time; the part
        # begins with the line after it.
        begins = steps and not self._stepped and (frame, time) in self._parts[self._part][0]
        begun = self._part + (steps and not begins)
        self._newest = time
        for part in range(begun, len(self._parts)):
            places, last = self._parts[part]
            found = places.get((frame, time))
            if found is not None or (time <= last and part > self._part):
                if steps or part > self._part:
                    self._stepped = steps
                self._part = part
                self.near = min(places.values()) if found is None else found
            if found is not None or time <= last:
                return found
        return None


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
