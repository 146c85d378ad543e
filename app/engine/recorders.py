"""Recordings of opened sources: starting them, and waiting for those that end."""

from __future__ import annotations

import logging
import time
from dataclasses import asdict
from pathlib import Path

from app.contract.commands import OpenSource, RecordOrder
from app.engine.recording import RunRecorder
from app.engine.recording_room import make_room
from observer.errors import SourceError
from observer.mount import CameraMount
from observer.recording.errors import RecordingError
from observer.recording.payloads import RunFacts
from observer.recording.ring import Ring
from observer.recording.writer import RecordingWriter
from observer.sources.contract import SourceInfo

_log = logging.getLogger(__name__)


class Recorders:
    """Recorder factory that, when the engine leaves, waits for the recordings still ending."""

    def __init__(self) -> None:
        self._all: list[RunRecorder] = []

    def begin(
        self,
        command: OpenSource,
        info: SourceInfo,
        calibration_yaml: str,
        mount: CameraMount | None,
    ) -> RunRecorder | None:
        """Begin a recording of the opened source, if ordered.

        Do not call it in the loop's thread: it opens a file. If a run continues, a failure to begin
        is only reported. Of a live source, which cannot be replayed, the last half minute is kept
        in any case.

        Args:
            info: of the source.
            calibration_yaml, mount: the calibration and mount it is observed with.

        Raises:
            RecordingError: the file cannot be written, or the disk is almost full.
        """
        order = command.record
        if (order is None or command.run_id is None) and not info.live:
            return None
        kept = order or RecordOrder("", "jpeg", "the last half minute")
        facts = RunFacts(
            id=command.run_id or "",
            name=kept.name,
            source=info.spec,
            info=asdict(info),
            calibration_yaml=calibration_yaml,
            images=kept.images,
            rig_yaml=command.rig_yaml,
            mount=None if mount is None else asdict(mount),
            preset=kept.preset,
            segment=command.segment,
            versions=kept.versions,
        )
        ring = Ring()
        if order is None or command.run_id is None:
            return RunRecorder(RecordingWriter(None, facts, ring=ring), None, ring=ring)
        resume, trouble = command.segment > 0, None
        try:
            writer = _opened(order, facts, ring, resume=resume)
        except RecordingError as error:
            if not resume:
                raise
            writer, trouble = None, str(error)
        recorder = RunRecorder(writer, order, ring=ring, trouble=trouble)
        self._all = [each for each in self._all if each.is_alive()] + [recorder]
        return recorder

    def wait(self, timeout_s: float) -> None:
        """Wait for the recordings that are ending."""
        until = time.monotonic() + timeout_s
        for recorder in self._all:
            recorder.join(max(0.0, until - time.monotonic()))


def _opened(order: RecordOrder, facts: RunFacts, ring: Ring, *, resume: bool) -> RecordingWriter:
    path = Path(order.path)
    make_room(path, order.reserve_bytes)
    if resume and path.exists():
        try:
            return RecordingWriter.resume(path, ring=ring)
        except SourceError as error:
            # Writing stopped before the file was a valid recording; keep it for inspection.
            _log.warning("a recording is restarted: %s", error)
            path.replace(path.with_suffix(".damaged.mcap"))
    return RecordingWriter(path, facts, ring=ring)
