"""Base of live captures: a thread that listens, and the intake it fills."""

from __future__ import annotations

import contextlib
import selectors
import socket
import threading
from collections.abc import Callable

from observer.truth.live.contract import LiveCaptureReport
from observer.truth.live.intake import Intake
from observer.truth.motion_capture import BodySample

_RETRY_S = 1.0
_CLOSE_WITHIN_S = 2.0


class Wakeup:
    """Waits for a socket; another thread can end the wait at once."""

    def __init__(self) -> None:
        self._ended = threading.Event()
        self._woken, self._waker = socket.socketpair()
        self._waker.setblocking(False)

    @property
    def ended(self) -> bool:
        return self._ended.is_set()

    def end(self) -> None:
        """End the waits, from any thread; safe to call twice."""
        self._ended.set()
        with contextlib.suppress(OSError):
            self._waker.send(b"!")

    def wait(self, timeout_s: float, to_read: socket.socket, *, to_write: bool = False) -> bool:
        """Wait for the socket; return False on time-out or after ``end`` was called."""
        with selectors.DefaultSelector() as selector:
            wanted = selectors.EVENT_WRITE if to_write else selectors.EVENT_READ
            selector.register(to_read, wanted)
            selector.register(self._woken, selectors.EVENT_READ)
            ready = selector.select(timeout_s)
        return not self.ended and any(key.fileobj is to_read for key, _ in ready)

    def pause(self, seconds: float) -> None:
        """Wait for this many seconds, or until ``end``."""
        self._ended.wait(seconds)

    def close(self) -> None:
        """Release the sockets; called by the waiting thread when it ends."""
        self._woken.close()
        self._waker.close()


class LiveCapture:
    """A connection that reconnects by itself. No call waits for the network.

    Methods may be called from any thread; ``drain`` returns each sample once. Its own thread runs
    the subclass's ``_listened``.

    Args:
        intake: where samples go. spec: as opened, for people and records.
        name: of the thread. clock: host's monotonic clock.
    """

    def __init__(self, intake: Intake, *, spec: str, name: str, clock: Callable[[], float]) -> None:
        self._intake = intake
        self.spec = spec
        self._clock = clock
        self._wakeup = Wakeup()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def drain(self) -> tuple[BodySample, ...]:
        """Return the samples since the last call in order of arrival, at most ``MOST_KEPT``.

        Each body's times increase. A sample without a position means that it was not seen then.
        """
        return self._intake.drain()

    def report(self) -> LiveCaptureReport:
        """Return the state of the connection."""
        return self._intake.report()

    def close(self) -> None:
        """End the connection; safe to call twice."""
        self._wakeup.end()
        # Resolving a host name cannot be interrupted, so do not wait for that.
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
            self._intake.lost(f"{self.spec} is no longer listened to")
            self._wakeup.close()

    def _listened(self) -> str | None:
        """Listen until it fails or is ended; return one sentence about the failure, if any."""
        raise NotImplementedError
