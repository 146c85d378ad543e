"""Thread beside the loop that works on the latest job and drops older ones."""

from __future__ import annotations

import contextlib
import math
import os
import sys
import threading
import time
from collections.abc import Callable
from typing import Generic, TypeVar

Job = TypeVar("Job")

# The loop takes precedence where both want the same core.
_NICENESS = 10
# Seconds that ``close`` waits for the thread; being a daemon thread, it never blocks the exit.
_STOP_TIMEOUT_S = 0.5


class LatestWorker(Generic[Job]):
    """Worker for the newest job at a limited rate; jobs never queue.

    The thread starts with the first job.
    """

    def __init__(
        self, name: str, work: Callable[[Job], None], *, rate_hz: float, most_share: float = 1.0
    ) -> None:
        """Prepare the worker.

        Args:
            name: of the thread.
            work: called in the thread; it must not raise, because that would end the thread.
            rate_hz: maximum average number of jobs per second, however irregularly they arrive.
            most_share: maximum share of one core's time; costlier jobs run less often.
        """
        self._name = name
        self._work = work
        self._interval = 1.0 / rate_hz
        self._rest = 1.0 / most_share - 1.0
        self._changed = threading.Condition()
        self._newest: Job | None = None
        self._due = -math.inf
        self._closing = False
        self._thread: threading.Thread | None = None

    def give(self, job: Job) -> None:
        """Replace any waiting job with this one; returns at once."""
        with self._changed:
            if self._closing:
                return
            self._newest = job
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name=self._name, daemon=True)
                self._thread.start()
            self._changed.notify()

    def forget(self) -> None:
        """Drop the waiting job; the one in progress continues."""
        with self._changed:
            self._newest = None

    def close(self) -> None:
        """Drop the waiting job and end the thread after the current one; safe to call twice."""
        with self._changed:
            self._closing = True
            self._newest = None
            self._changed.notify()
        if self._thread is not None:
            self._thread.join(_STOP_TIMEOUT_S)

    def _run(self) -> None:
        _step_back()
        while (job := self._next()) is not None:
            began = time.thread_time()
            self._work(job)
            rest = self._rest * (time.thread_time() - began)
            if rest > 0:
                with self._changed:
                    self._due = max(self._due, time.monotonic() + rest)

    def _next(self) -> Job | None:
        """Wait for a job and for its turn; return None once the worker is closed."""
        with self._changed:
            while not self._closing:
                if self._newest is None:
                    self._changed.wait()
                    continue
                now = time.monotonic()
                wait = self._due - now
                if wait > 0:
                    self._changed.wait(wait)
                    continue
                # The next job makes up for a small delay; after a larger one the schedule restarts.
                self._due = (now if wait < -self._interval else self._due) + self._interval
                job, self._newest = self._newest, None
                return job
        return None


def _step_back() -> None:
    """Lower the calling thread's priority where threads have their own (Linux)."""
    if sys.platform == "linux":
        with contextlib.suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICENESS)
