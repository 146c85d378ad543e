"""A recording as a source: the run's frames with all their original numbers."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import msgspec

from observer.errors import SourceError
from observer.recording.payloads import Begins, RunFacts
from observer.recording.reader import Recording
from observer.sources.contract import SkippedFrame, SourceInfo
from observer.types import StereoFrame

KIND = "recording"


class RecordingSource:
    """Plays a recording; fulfils ``Source`` and ``SeekableSource``.

    Indexes and times are those that the observer originally got, so that its results are
    reproducible; ``received`` is new. A frame whose images are lost is skipped.

    Args:
        path: of the file, finished or not.

    Attributes:
        recording: the recording played. calibration: with which the run was observed.
        position, begins: as in ``SeekableSource``.

    Raises:
        SourceError: the file is not a recording, or it holds no images.
    """

    def __init__(self, path: Path | str) -> None:
        self.recording = Recording(path)
        try:
            self.calibration = self.recording.calibration()
            self._check()
            self.info = _info(self.recording.facts, str(path), len(self.recording.frames))
        except BaseException:
            self.recording.close()
            raise
        self.position = 0

    def _check(self) -> None:
        frames, name = self.recording.frames, self.recording.path.name
        if not frames:
            raise SourceError(f"{name} contains no frames; give the recording of a longer run")
        if not self.recording.images_held:
            raise SourceError(
                f"{name} was recorded without images, so it cannot be played (its observations can "
                "be read); record with jpeg or lossless images instead"
            )

    @property
    def begins(self) -> Begins | None:
        return self.recording.frames[self.position - 1].begins if self.position else None

    def read(self) -> StereoFrame | SkippedFrame | None:
        frames = self.recording.frames
        if self.position >= len(frames):
            return None
        recorded = frames[self.position]
        self.position += 1
        try:
            left, right = self.recording.pair(self.position - 1)
        except SourceError as error:
            return SkippedFrame(recorded.index, str(error))
        return StereoFrame(
            index=recorded.index,
            time=recorded.time,
            left=left,
            right=right,
            received=time.monotonic(),
            right_time=recorded.right_time,
            odometry=recorded.odometry,
        )

    def seek(self, position: int) -> None:
        count = len(self.recording.frames)
        if not 0 <= position <= count:
            raise SourceError(
                f"there is no frame {position} in {self.info.spec}; frames are 0 to {count - 1}"
            )
        self.position = position

    def rewind(self) -> None:
        self.position = 0

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
