"""A thread beside the loop that works on the latest of what it is given, and on nothing older."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import time
from collections.abc import Callable
from typing import Generic, TypeVar

Job = TypeVar("Job")

# The loop goes first where both want the same core.
_NICENESS = 10
# Who ends the worker is waited for as well; a daemon thread holds up nothing.
_STOP_TIMEOUT_S = 0.5


class LatestWorker(Generic[Job]):
    """Works on the newest job, at most so many times a second; jobs never queue.

    The thread begins with the first job, so who never gives one has none.
    """

    def __init__(
        self,
        name: str,
        work: Callable[[Job], None],
        *,
        rate_hz: float,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """
        Args:
            name: of the thread.
            work: called in the thread; it must not raise, for then nothing more is worked on.
            rate_hz: most jobs per second, on average over whatever rhythm they come in.
            clock: the host's monotonic clock.
        """
        self._name = name
        self._work = work
        self._interval = 1.0 / rate_hz
        self._clock = clock
        self._changed = threading.Condition()
        self._newest: Job | None = None
        self._due: float | None = None
        self._closing = False
        self._thread: threading.Thread | None = None

    def give(self, job: Job) -> None:
        """Have this worked on in place of whatever still waits; returns at once."""
        with self._changed:
            if self._closing:
                return
            self._newest = job
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name=self._name, daemon=True)
                self._thread.start()
            self._changed.notify()

    def forget(self) -> None:
        """Drop what still waits; what is being worked on goes on."""
        with self._changed:
            self._newest = None

    def close(self) -> None:
        """Drop what waits, end the thread behind the job at hand; safe to call twice."""
        with self._changed:
            self._closing = True
            self._newest = None
            self._changed.notify()
        if self._thread is not None:
            self._thread.join(_STOP_TIMEOUT_S)

    def _run(self) -> None:
        _step_back()
        while (job := self._next()) is not None:
            self._work(job)

    def _next(self) -> Job | None:
        """Wait for a job and for its time; None once the worker is closed."""
        with self._changed:
            while not self._closing:
                if self._newest is None:
                    self._changed.wait()
                    continue
                now = self._clock()
                wait = 0.0 if self._due is None else self._due - now
                if wait > 0:
                    self._changed.wait(wait)
                    continue
                # A little lateness is made good by the next one; more of it begins anew.
                late = self._due is None or wait < -self._interval
                self._due = (now if late or self._due is None else self._due) + self._interval
                job, self._newest = self._newest, None
                return job
        return None


def _step_back() -> None:
    """Lower the calling thread's priority where single threads have one (Linux)."""
    if sys.platform == "linux":
        with contextlib.suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICENESS)
