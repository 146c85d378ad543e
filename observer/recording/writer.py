"""Writer of a recording during the run: one thread, bounded memory, readable at any time."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO, cast

from observer.recording.container import Container
from observer.recording.encoder import Encoded, Encoder
from observer.recording.errors import RecordingError
from observer.recording.payloads import RunFacts
from observer.recording.reader import Recording
from observer.recording.ring import Ring

# A killed process must lose at most a second; the other half is for delays before the writer.
CHUNK_S = 0.5


class RecordingWriter(Encoder):
    """Records everything that happens in a run. It has no thread of its own and is used by one.

    A chunk ends at least every ``CHUNK_S`` and at 8 MB, as long as something is written or
    ``flush`` is called.

    Args:
        file: a path, which is created or overwritten, or a file open for writing; with None only
            the ring is filled.
        facts: of the run. ring: also gets every message.

    Raises:
        RecordingError: the file cannot be written; all later calls raise it too. Everything
            written until then stays readable, and ``finish`` only closes the file.
        CalibrationError: the calibration's text cannot be used.
    """

    def __init__(
        self, file: Path | BinaryIO | None, facts: RunFacts, *, ring: Ring | None = None
    ) -> None:
        super().__init__(facts)
        self._open(file, "wb", ring)
        try:
            self._begin()
            # From here on the file is a valid recording, whatever happens.
            if self._container is not None:
                self._container.write_chunks()
        except BaseException:
            self.finish()
            raise

    @classmethod
    def resume(cls, path: Path, *, ring: Ring | None = None) -> RecordingWriter:
        """Resume a recording whose writer ended or was killed.

        The next frame counts as the first one of a new observer.

        Raises:
            SourceError: it is not a recording. RecordingError: it cannot be written.
        """
        with Recording(path) as recording:
            facts, images = recording.facts, recording.images_held.stop
            after = recording.end_ns
        writer = cls.__new__(cls)
        Encoder.__init__(writer, facts, first_image=images, after_ns=after)
        writer._open(path, "r+b", ring)
        return writer

    def _open(self, file: Path | BinaryIO | None, mode: str, ring: Ring | None) -> None:
        self._ring = ring
        self._container: Container | None = None
        self._own_file: BinaryIO | None = None
        # Since when messages have been waiting for their chunk.
        self._waiting_since: float | None = None
        if file is None:
            return
        if not isinstance(file, Path):
            self._container = Container(file, getattr(file, "name", None) or "of the run")
            return
        try:
            # Unbuffered: written data is with the system even if this process is killed.
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
    def size(self) -> int:
        """Size of the file, bytes."""
        return 0 if self._container is None else self._container.size

    def flush(self, now: float) -> None:
        """Write messages that have waited long enough; cheap, to be called while nothing comes in.

        Args:
            now: the host's monotonic clock.
        """
        waiting = self._waiting_since
        if self._container is None or waiting is None or now - waiting < CHUNK_S:
            return
        self._waiting_since = None
        self._container.write_chunks()

    def finish(self) -> None:
        """Write pending messages and the index, and close the file if it was opened here.

        Safe to call twice, and after an error, when it only closes the file.
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
        now = time.monotonic()
        if self._waiting_since is None:
            self._waiting_since = now
        self.flush(now)


def complete(path: Path) -> None:
    """Add the missing index to a recording whose writer was killed, so that tools open it fast.

    Raises:
        SourceError: it is not a recording. RecordingError: it cannot be written.
    """
    RecordingWriter.resume(path).finish()
