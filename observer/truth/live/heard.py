"""What every live capture has: a thread that listens, and the intake it fills."""

from __future__ import annotations

import threading
from collections.abc import Callable

from observer.truth.live.contract import LiveCaptureReport
from observer.truth.live.intake import Intake
from observer.truth.live.wakeup import Wakeup
from observer.truth.motion_capture import BodySample

_RETRY_S = 1.0
_CLOSE_WITHIN_S = 2.0


class HeardCapture:
    """Fulfils ``LiveCapture`` by a thread of its own; what it listens to is a subclass's.

    Args:
        intake: where samples go. spec: as it was opened. name: of the thread.
        clock: host's monotonic clock.
    """

    def __init__(self, intake: Intake, *, spec: str, name: str, clock: Callable[[], float]) -> None:
        self._intake = intake
        self._spec = spec
        self._clock = clock
        self._wakeup = Wakeup()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    @property
    def spec(self) -> str:
        return self._spec

    def drain(self) -> tuple[BodySample, ...]:
        return self._intake.drain()

    def report(self) -> LiveCaptureReport:
        return self._intake.report()

    def close(self) -> None:
        self._wakeup.end()
        # Looking a host's name up cannot be ended; nobody waits for that.
        self._thread.join(_CLOSE_WITHIN_S)

    # --- the thread ---------------------------------------------------------------------------

    def _run(self) -> None:
        try:
            while not self._wakeup.ended:
                trouble = self._listened()
                if trouble is not None:
                    self._intake.lost(trouble)
                self._wakeup.pause(_RETRY_S)
        finally:
            self._intake.lost(f"nobody listens to {self._spec} any more")
            self._wakeup.close()

    def _listened(self) -> str | None:
        """Listen until it cannot go on or is ended; one sentence of what hinders it, if any."""
        raise NotImplementedError
