"""Files that ``observe`` writes besides its lines: a recording and a video."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path

from app.cli.output import refusing
from observer.calibration.formats.opencv_file import calibration_text
from observer.camera import StereoCalibration
from observer.errors import InputError
from observer.exporting.overlay import draw_overlay
from observer.exporting.video import FALLBACK_RATE, OverlayVideo
from observer.jsonl import ObservationLine
from observer.parameters import Parameters
from observer.recording.observed import ObservedWriter
from observer.recording.payloads import Images, ParameterRevision, RunFacts
from observer.recording.writer import RecordingWriter
from observer.sources.contract import SkippedFrame, SourceInfo
from observer.truth.contract import Truth
from observer.types import Observation, StereoFrame
from observer.vision.rectification import Rectification
from observer.whole_files import whole_file


class Keeper:
    """Writer of each frame as it was observed; does nothing without a recording and a video.

    Args:
        rectification: of the frames; used only for the video, so that it does not interfere with
            observing.
    """

    def __init__(
        self,
        writer: RecordingWriter | None,
        video: OverlayVideo | None,
        truth: Truth | None,
        rectification: Rectification,
    ) -> None:
        self._writer = writer
        self._observed = None if writer is None else ObservedWriter(writer, truth)
        self._video = video
        self._rectification = rectification

    @property
    def video_summary(self) -> str:
        """Describe the length and encoding of the video."""
        assert self._video is not None
        return f"{self._video.pictures} frames as {self._video.codec}"

    def frame(self, frame: StereoFrame) -> None:
        """Record a frame that is about to be observed."""
        if self._writer is not None:
            self._writer.frame(frame)

    def observed(self, frame: StereoFrame, observation: Observation, line: ObservationLine) -> None:
        """Write the observation of a frame."""
        if self._observed is not None:
            self._observed.write(frame, observation, line)
        if self._video is not None:
            left = self._rectification.apply_left(frame.left)
            self._video.add(draw_overlay(left, line), frame.time)

    def skipped(self, skipped: SkippedFrame) -> None:
        """Record that a frame could not be read."""
        if self._writer is not None:
            self._writer.skipped(skipped, time.monotonic())

    def waited(self) -> None:
        """Flush the recording: a live source had no new frame."""
        if self._writer is not None:
            self._writer.flush(time.monotonic())


@contextmanager
def keeping(
    info: SourceInfo,
    truth: Truth | None,
    calibration: StereoCalibration,
    parameters: Parameters,
    preset: str,
    *,
    record: Path | None,
    images: Images,
    video: Path | None,
) -> Iterator[Keeper]:
    """Yield a keeper for the block; its files are complete when the block ends.

    Args:
        calibration, parameters, preset: used to observe.
        record, video: files, or None. images: which images are recorded.

    Raises:
        InputError: a file cannot be written. RecordingError, ExportError: writing ended early.
    """
    with ExitStack() as stack:
        writer = recorded = None
        if record is not None:
            part = stack.enter_context(_whole(record))
            writer = RecordingWriter(part, _facts(info, calibration, preset, images, record.stem))
            stack.callback(writer.finish)
            revision = ParameterRevision(revision=0, values=parameters.flat())
            writer.parameters(revision, time.monotonic())
        if video is not None:
            part = stack.enter_context(_whole(video))
            recorded = stack.enter_context(_finished(part, info.frame_rate or FALLBACK_RATE))
        yield Keeper(writer, recorded, truth, Rectification(calibration))


@contextmanager
def _whole(path: Path) -> Iterator[Path]:
    """Provide a path to write to as ``whole_file`` does; leave an unfinished file if writing fails.

    An interrupt is the normal end of observing a live source, so the file so far is the result.
    """
    if not path.parent.is_dir() or not os.access(path.parent, os.W_OK) or path.is_dir():
        raise InputError(f"cannot write {path}; name a file in an existing, writable folder")
    interrupt: KeyboardInterrupt | None = None
    with refusing(path), whole_file(path, keep_unfinished=True) as part:
        # Left by an earlier failure; it must not become the result of this block.
        part.unlink(missing_ok=True)
        try:
            yield part
        except KeyboardInterrupt as error:
            if not part.exists():
                raise
            interrupt = error
    if interrupt is not None:
        raise interrupt


@contextmanager
def _finished(path: Path, frame_rate: float) -> Iterator[OverlayVideo]:
    video = OverlayVideo(path, frame_rate)
    try:
        yield video
        video.finish()
    except KeyboardInterrupt:
        if video.pictures:
            video.finish()
        raise
    finally:
        video.abort()


def _facts(
    info: SourceInfo, calibration: StereoCalibration, preset: str, images: Images, name: str
) -> RunFacts:
    from app.versions import versions

    return RunFacts(
        # Not a run of the server, but unique enough to tell runs apart.
        id=f"observe-{datetime.now(UTC):%Y%m%d-%H%M%S-%f}",
        name=name,
        source=info.spec,
        info=asdict(info),
        calibration_yaml=calibration_text(calibration),
        images=images,
        mount=None if info.mount is None else asdict(info.mount),
        preset=preset,
        versions=versions(),
    )
