"""Recording beside the loop: a bounded queue and one thread around ``RecordingWriter``.

The loop only puts references into the queue; the thread packs and writes. If the disk cannot keep
up, frames are dropped and counted; if it is full, the recording ends, but not the run.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

from app.contract.answers import KeptClip
from app.contract.commands import RecordOrder
from app.contract.status import EgoMotionStatus, RecordingStatus
from app.engine.dense_stereo import Cloud
from app.engine.errors import NotNow, unexpected
from app.engine.playback import PlayedFrame
from app.engine.recording_room import almost_full, free_bytes, make_room
from observer.jsonl import ObservationLine
from observer.navigation.parameters import AllParameters
from observer.recording.errors import RecordingError
from observer.recording.payloads import Incident, LocalMapPayload, ParameterRevision, RobotRow
from observer.recording.ring import Ring
from observer.recording.writer import RecordingWriter
from observer.sources.contract import SkippedFrame
from observer.truth.matching import TrueBodyEntry
from observer.truth.motion_capture import BodySample
from observer.truth.sampled import TruthSample

_log = logging.getLogger(__name__)

# Seven seconds of a grey 640x480 pair at 30 frames a second.
MOST_BYTES = 128 << 20
# Messages without images, which are small: enough for a disk that stalls for minutes.
_MOST_MESSAGES = 20_000
_FLUSH_S = 0.2
_LOOK_AT_DISK_S = 1.0

Work = Callable[[RecordingWriter], None]
# Takes the saved clip, or why there is none; it must not raise.
ClipReply = Callable[[KeptClip | RecordingError], None]


class RunRecorder(threading.Thread):
    """Recorder of one run; starts itself.

    All methods return at once; all but ``capture`` and ``cloud`` are for the loop's thread only.
    The thread ends when the file is complete or abandoned after ``end``.

    Args:
        writer: writes the file; None records nothing.
        trouble: the reason if there is no writer.
        order: the recording as ordered; None fills only the ring buffer.
        ring: the writer's ring buffer, if any.
        most_bytes: limit for the frames that wait for the disk.
        free: returns the free space on the disk of a file.
    """

    def __init__(
        self,
        writer: RecordingWriter | None,
        order: RecordOrder | None,
        *,
        ring: Ring | None = None,
        trouble: str | None = None,
        most_bytes: int = MOST_BYTES,
        free: Callable[[Path], int] = free_bytes,
    ) -> None:
        super().__init__(name="recording", daemon=True)
        self._writer = writer
        self._order = order
        self._path = None if order is None else Path(order.path)
        self._ring = ring
        self._trouble = trouble
        self._most_bytes = most_bytes
        self._free = free
        self._began = time.monotonic()
        self._bytes = 0 if writer is None else writer.size
        self._seconds = 0.0
        self._changed = threading.Condition()
        self._waiting: deque[tuple[Work, int]] = deque()
        self._waiting_bytes = 0
        # Replies of the clips that are still to be saved.
        self._clips: list[ClipReply] = []
        self._dropped = 0
        # Dropped, but not yet noted in the recording.
        self._unreported_drops = 0
        self._ending = False
        self._done: Callable[[], None] | None = None
        # The first frame of a segment was dropped: the next frame begins the segment.
        self._owed = False
        self._disk_looked_at = time.monotonic()
        self.start()

    def facts(self) -> RecordingStatus | None:
        """Return the facts as ``StateEvent.recording`` holds them; None with only the ring kept."""
        if self._order is None:
            return None
        return RecordingStatus(
            images=self._order.images,
            bytes=self._bytes,
            seconds=round(self._seconds, 1),
            dropped=self._dropped,
            trouble=self._trouble,
        )

    # --- what is recorded --------------------------------------------------------------------

    def frame(self, played: PlayedFrame) -> None:
        """Record a frame exactly as it will be observed; the arrays must not change."""
        frame, begins = played.frame, played.new_segment or self._owed

        def write(writer: RecordingWriter) -> None:
            writer.frame(
                frame,
                source_position=played.position,
                source_time=played.source_time,
                begins="segment" if begins else None,
            )

        taken = self._give(write, frame.left.nbytes + frame.right.nbytes)
        self._owed = begins and not taken

    def observation(
        self,
        line: ObservationLine,
        received: float,
        ego_motion: EgoMotionStatus | None,
        truth: Sequence[TrueBodyEntry],
        no_truth: str | None = None,
    ) -> None:
        """Record the result of a frame, as in the ``ObservationEvent``.

        Args:
            no_truth: why there is no truth yet where there will be some.
        """

        def write(writer: RecordingWriter) -> None:
            motion = None if ego_motion is None else asdict(ego_motion)
            writer.observation(line, received, ego_motion=motion, truth=truth, no_truth=no_truth)

        self._give(write)

    def cloud(self, cloud: Cloud, received: float) -> None:
        """Record a point cloud with its frame's reception time; any thread may call."""
        self._give(lambda w: w.cloud(cloud.points, cloud.colors, received))

    def truth(self, sample: TruthSample, received: float) -> None:
        """Record the ground truth at a frame, in the truth's own world."""
        self._give(lambda w: w.truth(sample, received))

    def parameters(
        self,
        parameters: AllParameters,
        revision: int,
        *,
        before: AllParameters | None = None,
        frame: int | None = None,
    ) -> None:
        """Record parameters that take effect from the next frame on.

        Args:
            before: the parameters until then.
            frame: index of the first frame they apply to.
        """
        values = dict(parameters.flat())
        old = values if before is None else before.flat()
        difference = {name: value for name, value in values.items() if old.get(name) != value}
        recorded = ParameterRevision(
            revision=revision, values=values, frame=frame, difference=difference
        )
        now = time.monotonic()
        self._give(lambda w: w.parameters(recorded, now), always=True)

    def robots(self, rows: Sequence[RobotRow], incidents: Sequence[Incident]) -> None:
        """Record the commands sent to robots and their reports."""

        def write(writer: RecordingWriter) -> None:
            for row in rows:
                writer.robot(row)
            for incident in incidents:
                writer.incident(incident)

        self._give(write)

    def local_map(self, payload: LocalMapPayload) -> None:
        """Record the local map of a frame."""
        self._give(lambda w: w.local_map(payload))

    def capture(self, samples: Sequence[BodySample]) -> None:
        """Record motion capture samples; any thread may call."""
        self._give(lambda w: w.capture(samples))

    def skipped(self, skipped: SkippedFrame) -> None:
        """Record a frame that the source could not read."""
        now = time.monotonic()
        self._give(lambda w: w.skipped(skipped, now))

    def incident(self, kind: str, sentence: str) -> None:
        """Record an incident, so that it can be found later."""
        incident = Incident(kind=kind, sentence=sentence, received=time.monotonic())
        self._give(lambda w: w.incident(incident))

    def save_clip(self, path: Path, reserve_bytes: int, done: ClipReply) -> None:
        """Queue the last half minute for writing.

        Args:
            done: called exactly once, in another thread, even if the recording ends before.

        Raises:
            NotNow: no last half minute is kept at the moment.
        """
        # One lock for looking and queueing: a recording given up in between would never reply.
        with self._changed:
            ring = self._ring
            if ring is None or self._trouble is not None or self._ending:
                raise NotNow(self._trouble or "the recording is ending; try again in a moment")
            if not self._give(lambda _: self._reply(done, _saved_clip(ring, path, reserve_bytes))):
                raise NotNow("the disk is too slow; try again in a moment")
            self._clips.append(done)

    def end(self, done: Callable[[], None] | None = None) -> None:
        """Write what is queued and close the file; returns at once, safe to call twice.

        Args:
            done: called in another thread when the file is complete or given up.
        """
        with self._changed:
            if self._ending:
                return
            self._done = done
            self._ending = True
            self._changed.notify()

    def _give(self, work: Work, size: int = 0, *, always: bool = False) -> bool:
        """Queue a piece of work; return False if it was dropped.

        Args:
            size: bytes of its images.
            always: never drop it, however slow the disk is: only for rare, small messages without
                which a re-run would differ.
        """
        with self._changed:
            if self._trouble is not None or self._ending:
                return True
            full = size and self._waiting_bytes + size > self._most_bytes
            # At least one frame always fits, however large it is.
            many = len(self._waiting) >= _MOST_MESSAGES and not always
            if (full and self._waiting_bytes) or many:
                self._dropped += 1
                self._unreported_drops += 1
                return False
            self._waiting.append((work, size))
            self._waiting_bytes += size
            self._changed.notify()
            return True

    # --- the thread --------------------------------------------------------------------------

    def run(self) -> None:
        """Write until ``end``."""
        # Keep the loop's priority: a lower-priority thread that lost its core while holding the GIL
        # would block the loop, and with it the robots' sight.
        try:
            while (job := self._next()) is not None:
                self._step(*job)
        finally:
            self._close()
            done, self._done = self._done, None
            if done is not None:
                done()

    def _next(self) -> tuple[Work, int] | None:
        """Return the next piece of work, an idle item once in a while, or None at the end."""
        with self._changed:
            if not self._waiting and not self._ending:
                self._changed.wait(_FLUSH_S)
            if self._waiting:
                return self._waiting.popleft()
            return None if self._ending else ((lambda _: None), 0)

    def _step(self, work: Work, size: int) -> None:
        writer, now = self._writer, time.monotonic()
        try:
            if writer is not None:
                self._tell_of_lost(writer, now)
                work(writer)
                writer.flush(now)
                self._bytes, self._seconds = writer.size, now - self._began
                self._look_at_disk(now)
        except RecordingError as error:
            self._give_up(str(error))
        except Exception as error:  # noqa: BLE001
            # A failure to record must end neither this thread nor the run.
            _log.exception("recording failed")
            self._give_up(f"the recording stopped: {unexpected(error)}")
        finally:
            with self._changed:
                self._waiting_bytes -= size

    def _tell_of_lost(self, writer: RecordingWriter, now: float) -> None:
        with self._changed:
            lost, self._unreported_drops = self._unreported_drops, 0
        if lost:
            sentence = f"{lost} messages were not recorded because the disk was too slow"
            writer.incident(Incident(kind="not_recorded", sentence=sentence, received=now))

    def _look_at_disk(self, now: float) -> None:
        if self._order is None or self._path is None:
            return
        if now - self._disk_looked_at < _LOOK_AT_DISK_S:
            return
        self._disk_looked_at = now
        with contextlib.suppress(OSError):
            left = self._free(self._path)
            if left < self._order.reserve_bytes:
                self._give_up(almost_full(self._path, left, self._order.reserve_bytes))

    def _give_up(self, trouble: str) -> None:
        """Give up the recording while the run continues; what was written stays readable."""
        with self._changed:
            self._trouble = trouble
            self._waiting.clear()
            self._waiting_bytes = 0
        self._close()

    def _close(self) -> None:
        # Callers may keep this object long after the end to query the outcome, so free its buffers,
        # a quarter of a gigabyte.
        writer, self._writer, self._ring = self._writer, None, None
        if writer is not None:
            self._finish(writer)
        for done in tuple(self._clips):
            why = self._trouble or "the recording ended before its last half minute was saved"
            self._reply(done, RecordingError(why, full=False))

    def _finish(self, writer: RecordingWriter) -> None:
        try:
            writer.finish()
        except RecordingError as error:
            self._trouble = self._trouble or str(error)
        except Exception as error:  # noqa: BLE001
            # Those who wait for the end of the recording must still get their replies.
            _log.exception("completing the recording failed")
            self._trouble = self._trouble or f"the recording is incomplete: {unexpected(error)}"
        if self._path is not None:
            with contextlib.suppress(OSError):
                self._bytes = self._path.stat().st_size

    def _reply(self, done: ClipReply, clip: KeptClip | RecordingError) -> None:
        with self._changed:
            self._clips.remove(done)
        done(clip)


def _saved_clip(ring: Ring, path: Path, reserve_bytes: int) -> KeptClip | RecordingError:
    """Save a clip, or return why there is none.

    It is a separate file: whatever happens to it, the run's own recording continues.
    """
    try:
        make_room(path, reserve_bytes)
        ring.save(path)
        return KeptClip(path.stat().st_size, round(ring.seconds_held, 1))
    except RecordingError as error:
        return error
    except Exception as error:  # noqa: BLE001
        _log.exception("saving a clip failed")
        why = f"the clip {path.name} could not be saved: {unexpected(error)}"
        return RecordingError(why, full=False)
