"""Database writes outside the event loop: one thread, a bounded queue, no blocking."""

from __future__ import annotations

import asyncio
import queue
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import structlog

from app.server.errors import NotAvailable
from app.storage import StorageBusy, StorageError, StorageFull, StorageMissing
from observer.number_format import count_of

log = structlog.get_logger(__name__)

T = TypeVar("T")

_QUEUE_LENGTH = 200
_RETRY_S = 0.25
_AGAIN_S = 2.0
_STOP_TIMEOUT_S = 10.0


@dataclass(frozen=True)
class _Job:
    work: Callable[[], Any]
    done: Callable[[Any, BaseException | None], None] | None


class Writer:
    """Thread that runs writes one after the other, in the order given.

    It retries a locked database for ``patience_s``. Meanwhile the queue fills; once it is full,
    writes are refused (``submit``) or dropped and counted (``post``). Posted writes for which the
    disk has no room wait until it has, in order; submitted ones do not wait behind them.

    Attributes:
        trouble: one sentence on the last failed write, or on those that wait for room; None after a
            success.
        dropped: number of posted writes that were lost.
    """

    def __init__(
        self,
        *,
        queue_length: int = _QUEUE_LENGTH,
        patience_s: float = 60.0,
        again_s: float = _AGAIN_S,
    ) -> None:
        self._jobs: queue.Queue[_Job | None] = queue.Queue(queue_length)
        # Writes that wait for room; only used in the thread.
        self._waiting: deque[Callable[[], Any]] = deque()
        self._most_waiting = queue_length
        self._again_s = again_s
        self._again_at = 0.0
        self._patience_s = patience_s
        self._logged: str | None = None
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="storage-writer", daemon=True)
        self.trouble: str | None = None
        self.dropped = 0

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        """Finish the queued writes (one attempt each) and end the thread."""
        if not self._thread.is_alive():
            return
        self._stopping.set()
        try:
            self._jobs.put(None, timeout=_STOP_TIMEOUT_S)
        except queue.Full:
            log.error("storage_writer_stuck", queued=self._jobs.qsize())
        self._thread.join(_STOP_TIMEOUT_S)

    def post(
        self,
        work: Callable[[], Any],
        done: Callable[[Any, BaseException | None], None] | None = None,
    ) -> bool:
        """Queue a write; return False if the queue is full and the write was not taken.

        Args:
            done: called in the writer's thread when the write ends; it then handles a failure.
                Otherwise the write waits for room on a full disk; any other failure counts as
                dropped.
        """
        try:
            self._jobs.put_nowait(_Job(work, done))
        except queue.Full:
            self.dropped += done is None
            return False
        return True

    async def submit(self, work: Callable[[], T], *, timeout_s: float = 8.0) -> T:
        """Write and wait for the result.

        Raises:
            NotAvailable: the queue is full, or it was not written in time but still may be.
            StorageError: raised by the write.
        """
        loop = asyncio.get_running_loop()
        future: asyncio.Future[T] = loop.create_future()

        def settle(value: Any, error: BaseException | None) -> None:
            if future.done():
                return
            if error is None:
                future.set_result(value)
            else:
                future.set_exception(error)

        def done(value: Any, error: BaseException | None) -> None:
            # The loop may be closed by the time a late write ends.
            if not loop.is_closed():
                loop.call_soon_threadsafe(settle, value, error)

        try:
            self._jobs.put_nowait(_Job(work, done))
        except queue.Full:
            raise NotAvailable(
                f"the database is too slow ({self.trouble or 'too many writes'}); try again"
            ) from None
        try:
            async with asyncio.timeout(timeout_s):
                return await future
        except TimeoutError:
            raise NotAvailable(
                "the database did not complete the write in time; it will be retried"
            ) from None

    def _run(self) -> None:
        while True:
            try:
                job = self._jobs.get(timeout=self._again_s if self._waiting else None)
            except queue.Empty:
                self._write_waiting()
                continue
            if job is None:
                break
            if self._waiting and time.monotonic() >= self._again_at:
                self._write_waiting()
            if job.done is not None:
                job.done(*self._do(job.work))
                self._tell_waiting()
            elif self._waiting:
                self._wait_for_room(job.work)
            else:
                self._write_posted(job.work)
        self._write_waiting()
        self.dropped += len(self._waiting)

    def _write_posted(self, work: Callable[[], Any]) -> None:
        _, error = self._do(work)
        if isinstance(error, StorageFull):
            self._wait_for_room(work)
        elif error is not None and not isinstance(error, StorageMissing):
            self.dropped += 1

    def _wait_for_room(self, work: Callable[[], Any]) -> None:
        """Keep a write until the disk has room; the oldest is lost if there are too many."""
        if not self._waiting:
            self._again_at = time.monotonic() + self._again_s
        if len(self._waiting) >= self._most_waiting:
            self._waiting.popleft()
            self.dropped += 1
        self._waiting.append(work)
        self._tell_waiting()

    def _write_waiting(self) -> None:
        """Write what waits for room, until the disk is full again."""
        count = len(self._waiting)
        while self._waiting:
            _, error = self._do(self._waiting[0])
            if isinstance(error, StorageFull):
                break
            self._waiting.popleft()
            self.dropped += error is not None and not isinstance(error, StorageMissing)
        else:
            if count:
                log.info("waiting_writes_stored", count=count)
        self._again_at = time.monotonic() + self._again_s
        self._tell_waiting()

    def _tell_waiting(self) -> None:
        if self._waiting:
            self.trouble = (
                f"the disk is full: {count_of(len(self._waiting), 'change')} of parameters, stops "
                "or settings took effect but will be stored only when it has room; free some disk "
                "space"
            )

    def _do(self, work: Callable[[], Any]) -> tuple[Any, BaseException | None]:
        """Return the result or error of a write; the same error in a row is logged once."""
        deadline = time.monotonic() + self._patience_s
        while True:
            try:
                value = work()
            except StorageBusy as error:
                self.trouble = str(error)
                if self._stopping.is_set() or time.monotonic() > deadline:
                    log.error("write_abandoned", reason=str(error))
                    return None, error
                self._stopping.wait(_RETRY_S)
            except StorageError as error:
                if not isinstance(error, StorageMissing):
                    self.trouble = str(error)
                    if self._logged != self.trouble:
                        log.error("write_failed", reason=self.trouble)
                    self._logged = self.trouble
                return None, error
            except Exception as error:
                # A bug in one write must not prevent all later ones.
                log.exception("write_crashed")
                return None, error
            else:
                self.trouble = None
                if not self._waiting:
                    self._logged = None
                return value, None
