"""A recording as a source: the run's frames with all their original numbers."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import msgspec

from observer.errors import SourceError
from observer.recording.payloads import Begins, RunFacts
from observer.recording.reader import Recording
from observer.recording.run_times import RunTimes
from observer.sources.contract import SkippedFrame, SourceInfo
from observer.types import StereoFrame

KIND = "recording"


class RecordingSource:
    """Plays a recording; fulfils ``Source`` and ``SeekableSource``.

    Indexes and times are those that the observer originally got, so that its results are
    reproducible; ``received`` is new. A frame whose images are lost is skipped.

    Args:
        path: of the file, finished or not.
        run_clock: deliver times on the run's clock, which also increases where an engine was
            replaced; ``Recording.truth`` is on that clock. The other times are the same.

    Attributes:
        recording: the recording played. calibration: with which the run was observed.
        times: of all frames as they are delivered, seconds.
        position, begins: as in ``SeekableSource``.

    Raises:
        SourceError: the file is not a recording, or it holds no images.
    """

    def __init__(self, path: Path | str, *, run_clock: bool = False) -> None:
        self.recording = Recording(path)
        try:
            self.calibration = self.recording.calibration()
            self._check()
            frames = self.recording.frames
            self.info = _info(self.recording.facts, str(path), len(frames))
            offsets = RunTimes(frames).offsets if run_clock else (0.0,) * len(frames)
            self._offsets = offsets
            self.times = tuple(f.time + offset for f, offset in zip(frames, offsets, strict=True))
        except BaseException:
            self.recording.close()
            raise
        self.position = 0
        self.begins: Begins | None = None
        # What began at unreadable frames read since the last readable one.
        self._pending: Begins | None = None

    def _check(self) -> None:
        frames, name = self.recording.frames, self.recording.path.name
        if not frames:
            raise SourceError(f"{name} contains no frames; give the recording of a longer run")
        if not self.recording.images_held:
            raise SourceError(
                f"{name} was recorded without images, so it cannot be played (its observations can "
                "be read); record with jpeg or lossless images instead"
            )

    def read(self) -> StereoFrame | SkippedFrame | None:
        frames = self.recording.frames
        if self.position >= len(frames):
            return None
        recorded, offset = frames[self.position], self._offsets[self.position]
        self.position += 1
        # A new observer also begins a new segment.
        if self._pending == "observer":
            self.begins = self._pending
        else:
            self.begins = recorded.begins or self._pending
        try:
            left, right = self.recording.pair(self.position - 1)
        except SourceError as error:
            self._pending = self.begins
            return SkippedFrame(recorded.index, str(error))
        self._pending = None
        return StereoFrame(
            index=recorded.index,
            time=self.times[self.position - 1],
            left=left,
            right=right,
            received=time.monotonic(),
            right_time=None if recorded.right_time is None else recorded.right_time + offset,
            odometry=recorded.odometry,
        )

    def seek(self, position: int) -> None:
        count = len(self.recording.frames)
        if not 0 <= position <= count:
            raise SourceError(
                f"there is no frame {position} in {self.info.spec}; frames are 0 to {count - 1}"
            )
        if position != self.position:
            self.position = position
            self.begins = self._pending = None

    def rewind(self) -> None:
        self.seek(0)

    def close(self) -> None:
        """Close the file; safe to call twice."""
        self.recording.close()


def _info(facts: RunFacts, spec: str, frame_count: int) -> SourceInfo:
    try:
        recorded = msgspec.convert(facts.info, SourceInfo, strict=False)
    except msgspec.ValidationError as error:
        raise SourceError(f"{spec} is damaged: its source description is {error}") from None
    # Whatever the source was, it is now a file.
    return replace(recorded, spec=spec, kind=KIND, frame_count=frame_count, live=False, devices=())
