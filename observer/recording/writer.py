"""Writes a run's recording as it happens: one thread, bounded memory, readable at any time."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from observer.recording.container import Container
from observer.recording.encoder import Encoded, Encoder
from observer.recording.errors import RecordingError
from observer.recording.foxglove import LogLevel
from observer.recording.payloads import Begins, Incident, ParameterRevision, RobotRow, RunFacts
from observer.recording.reader import Recording
from observer.recording.ring import Ring
from observer.sources.contract import SkippedFrame
from observer.truth.csv_file import TruthSample
from observer.truth.motion_capture import BodySample
from observer.types import StereoFrame

# A killed process loses no more than a second; half of it is left to whatever comes before.
CHUNK_S = 0.5


class RecordingWriter:
    """Keeps everything that happens in a run. No thread of its own; used by one.

    A chunk ends at least every ``CHUNK_S`` and at 8 MB, as long as something is written or
    ``flush`` is called. ``received`` is the host's monotonic clock, seconds, everywhere.

    Args:
        file: a path, which is made anew, or something open for writing; None writes no file and
            only fills the ring.
        facts: of the run. ring: gets every message too.
        clock: the host's monotonic clock.

    Raises:
        RecordingError: the file cannot be written; so do all methods, once and for all. What was
            written until then stays readable, and ``finish`` only closes it.
        CalibrationError: the calibration's text cannot be used.
    """

    def __init__(
        self,
        file: Path | BinaryIO | None,
        facts: RunFacts,
        *,
        ring: Ring | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        encoder = Encoder(facts)
        self._set_up(encoder, facts, ring, clock)
        self._open(file, "wb")
        try:
            self._keep(encoder.beginning())
            # From here on the file is a recording, whatever happens.
            if self._container is not None:
                self._container.write_chunks()
        except BaseException:
            self.finish()
            raise

    @classmethod
    def resume(
        cls,
        path: Path,
        *,
        ring: Ring | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> RecordingWriter:
        """Go on with a recording whose writer ended or was killed.

        The next frame counts as the first one of a new observer.

        Raises:
            SourceError: it is no recording. RecordingError: it cannot be written.
        """
        with Recording(path) as recording:
            facts, images = recording.facts, recording.next_image
            after = recording.end_ns
        writer = cls.__new__(cls)
        writer._set_up(Encoder(facts, first_image=images, after_ns=after), facts, ring, clock)
        writer._open(path, "r+b")
        return writer

    def _set_up(
        self, encoder: Encoder, facts: RunFacts, ring: Ring | None, clock: Callable[[], float]
    ) -> None:
        self._encoder = encoder
        self._facts = facts
        self._ring = ring
        self._clock = clock
        self._container: Container | None = None
        self._own_file: BinaryIO | None = None
        # Since when something waits for its chunk.
        self._waiting_since: float | None = None

    def _open(self, file: Path | BinaryIO | None, mode: str) -> None:
        if file is None:
            return
        if not isinstance(file, Path):
            self._container = Container(file, getattr(file, "name", None) or "of the run")
            return
        try:
            # Without a buffer: what was written is with the system, whatever becomes of us.
            opened = cast(BinaryIO, file.open(mode, buffering=0))
        except OSError as error:
            raise RecordingError.of(error, file.name) from None
        try:
            self._container = Container(opened, file.name, resume=mode == "r+b")
        except BaseException:
            opened.close()
            raise
        self._own_file = opened

    @property
    def facts(self) -> RunFacts:
        """Of the run."""
        return self._facts

    @property
    def size(self) -> int:
        """Bytes in the file."""
        return 0 if self._container is None else self._container.size

    def frame(
        self,
        frame: StereoFrame,
        *,
        source_position: int | None = None,
        source_time: float | None = None,
        begins: Begins | None = None,
    ) -> None:
        """A frame exactly as the observer gets it, before it is observed.

        Args:
            source_position, source_time: within the source, where it is played in a loop.
            begins: ``segment`` where ``begin_segment`` was called for it.
        """
        self._keep(
            self._encoder.frame(
                frame, source_position=source_position, source_time=source_time, begins=begins
            )
        )

    def observation(
        self,
        line: Mapping[str, Any],
        received: float,
        *,
        ego_motion: Mapping[str, Any] | None = None,
        truth: Sequence[Mapping[str, Any]] = (),
    ) -> None:
        """What was found in a frame.

        Args:
            line: as of ``observer.jsonl.observation_line``. received: of its frame.
            ego_motion, truth: as in the engine's ``ObservationEvent``.
        """
        self._keep(self._encoder.observation(line, received, ego_motion=ego_motion))
        if truth:
            self._keep(self._encoder.matched_truth(line, truth, received))

    def truth(self, sample: TruthSample, received: float) -> None:
        """What is truly known at a frame: ``frame`` and ``time`` are those of the frame as it
        was observed, the world is the truth's own."""
        self._keep(self._encoder.truth(sample, received))

    def parameters(self, revision: ParameterRevision, received: float) -> None:
        """Parameters that act on the next frame that is written."""
        self._keep(self._encoder.parameters(revision, received))

    def capture(self, samples: Sequence[BodySample]) -> None:
        """What motion capture told since the last call."""
        self._keep(self._encoder.capture(samples))

    def robot(self, row: RobotRow) -> None:
        """One robot at one instant."""
        self._keep(self._encoder.robot(row))

    def skipped(self, skipped: SkippedFrame, received: float) -> None:
        """A frame that the source could not read."""
        self._keep(self._encoder.skipped(skipped, received))

    def incident(self, incident: Incident) -> None:
        """Something to be found again; it is in the log, too."""
        self._keep(self._encoder.incident(incident))

    def log(self, level: LogLevel, name: str, message: str, received: float) -> None:
        """A sentence for the log."""
        self._keep(self._encoder.log(level, name, message, received))

    def cloud(
        self, points: NDArray[np.float32], colors: NDArray[np.uint8], received: float
    ) -> None:
        """A dense cloud: points (N, 3), metres, in the camera frame, and RGB (N, 3).

        Args:
            received: of the frame that it was made of.
        """
        self._keep(self._encoder.cloud(points, colors, received))

    def flush(self, now: float) -> None:
        """Write what has waited for long enough; cheap, to be called when nothing else comes.

        Args:
            now: the host's monotonic clock.
        """
        waiting = self._waiting_since
        if self._container is None or waiting is None or now - waiting < CHUNK_S:
            return
        self._waiting_since = None
        self._container.write_chunks()

    def finish(self) -> None:
        """Write what waits and the index, and close the file if it was opened here.

        Safe to call twice, and after an error: then it only closes.
        """
        container, self._container = self._container, None
        try:
            if container is not None and container.failure is None:
                container.finish()
        finally:
            if self._own_file is not None:
                self._own_file.close()

    def _keep(self, messages: Sequence[Encoded]) -> None:
        if self._ring is not None:
            self._ring.keep(messages)
        if self._container is None or not messages:
            return
        for message in messages:
            self._container.add(*message)
        self._container.write_large()
        now = self._clock()
        if self._waiting_since is None:
            self._waiting_since = now
        self.flush(now)


def complete(path: Path) -> None:
    """Give a recording whose writer was killed its index, so that every tool opens it quickly.

    Raises:
        SourceError: it is no recording. RecordingError: it cannot be written.
    """
    RecordingWriter.resume(path).finish()
