"""Thread beside the loop that listens to motion capture and distributes its samples."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable

from app.engine.errors import unexpected
from app.engine.recording import RunRecorder
from observer.errors import DynamicObserverError
from observer.truth.live.contract import LiveCaptureReport
from observer.truth.live.heard import LiveCapture
from observer.truth.live.opening import open_live_truth
from observer.truth.motion_capture import BodySample

_log = logging.getLogger(__name__)

_DRAIN_EVERY_S = 0.02
_REPORT_EVERY_S = 0.5
# Samples kept while nobody takes them: half a minute of two bodies at 300 Hz.
_MOST_WAITING = 20_000

# Report before the first one of a connection.
CONNECTING = LiveCaptureReport("connecting", None, (), {}, {}, 0, 0, 0, None)

# Opens the live motion capture that a spec names.
CaptureOpener = Callable[[str], LiveCapture]


class MotionListener(threading.Thread):
    """Connection to motion capture and the thread that reads it; starts itself.

    Attributes:
        spec: names the motion capture.
        recorder: receives all samples, where there is one.
        report: the newest report.
        trouble: the reason why it no longer listens.
    """

    def __init__(self, spec: str, open_capture: CaptureOpener = open_live_truth) -> None:
        super().__init__(name="motion capture", daemon=True)
        self.spec = spec
        self.recorder: RunRecorder | None = None
        self.report = CONNECTING
        self.trouble: str | None = None
        self._open = open_capture
        self._for_frames: deque[BodySample] = deque(maxlen=_MOST_WAITING)
        self._for_alignment: deque[BodySample] = deque(maxlen=_MOST_WAITING)
        self._ending = threading.Event()
        self.start()

    def for_frames(self) -> list[BodySample]:
        """Return the samples since the last call; for the loop's thread."""
        return _taken(self._for_frames)

    def for_alignment(self) -> list[BodySample]:
        """Return the samples since the last call; for the alignment thread."""
        return _taken(self._for_alignment)

    def end(self) -> None:
        """Stop listening; returns at once, and the thread closes the connection."""
        self._ending.set()

    def run(self) -> None:
        """Listen until ``end`` or a failure."""
        try:
            capture = self._open(self.spec)
        except Exception as error:  # noqa: BLE001
            self._give_up(error)
            return
        try:
            self._listen(capture)
        except Exception as error:  # noqa: BLE001
            # A failure here must not stop observing frames or driving robots.
            self._give_up(error)
        finally:
            capture.close()

    def _listen(self, capture: LiveCapture) -> None:
        next_report = 0.0
        while not self._ending.wait(_DRAIN_EVERY_S):
            samples = capture.drain()
            if samples:
                self._for_frames.extend(samples)
                self._for_alignment.extend(samples)
                recorder = self.recorder
                if recorder is not None:
                    recorder.capture(samples)
            now = time.monotonic()
            if now >= next_report:
                self.report, next_report = capture.report(), now + _REPORT_EVERY_S

    def _give_up(self, error: Exception) -> None:
        if isinstance(error, DynamicObserverError):
            self.trouble = str(error)
            return
        _log.error("listening to motion capture failed", exc_info=error)
        self.trouble = f"listening to motion capture failed: {unexpected(error)}"


def _taken(waiting: deque[BodySample]) -> list[BodySample]:
    # Only one thread takes samples, so at least as many as counted are there.
    return [waiting.popleft() for _ in range(len(waiting))]
