"""Handle of a worker: one of our modules run in a low-priority process that ends with this one.

A job is cancelled by ending its worker, since no step inside a native library can be interrupted.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import signal
import subprocess
import threading
from asyncio.subprocess import DEVNULL, PIPE, Process
from collections.abc import AsyncIterator, Callable, Coroutine, Mapping
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from typing import Any, BinaryIO, TypeVar, cast

from app.runtime.child import exit_words
from app.runtime.environment import module_command, program_environment
from app.runtime.errors import ChannelError
from app.runtime.jobs import Progress, Refused
from app.runtime.pipe import encode, load_message, read_message
from observer.errors import DynamicObserverError

_COMMAND = module_command("app.runtime.worker_main")
_GRACE_S = 2.0
_HELD_S = 0.1
_log = logging.getLogger(__name__)

_Result = TypeVar("_Result")


class JobFailed(DynamicObserverError):
    """Failure of a job to produce a result; the sentence says why."""


@dataclass(frozen=True)
class Worker:
    """Definition of one kind of worker.

    Attributes:
        module: the module to run; see ``app.runtime.worker_main``.
        niceness: added to this process's own.
        environment: additions to the environment of every process that we start.
    """

    module: str
    niceness: int
    environment: Mapping[str, str] = field(default_factory=dict)

    def command(self, *arguments: str) -> list[str]:
        """Return the command line that starts a process as a child of this one."""
        own = (str(os.getpid()), str(self.niceness))
        return [*_COMMAND, *own, self.module, *arguments]

    @property
    def options(self) -> dict[str, Any]:
        """Return the keyword arguments for the function that starts a process."""
        # Own session: only the server receives a terminal's Ctrl-C.
        return {"env": {**program_environment(), **self.environment}, "start_new_session": True}

    @asynccontextmanager
    async def started(self, *arguments: str, **streams: int) -> AsyncIterator[Process]:
        """Start a process; end it and all that it started after the block.

        Args:
            streams: ``stdin``, ``stdout`` and ``stderr``; by default no input, discarded output,
                and our stderr.

        Raises:
            OSError: it cannot be started.
        """
        process = await asyncio.create_subprocess_exec(
            *self.command(*arguments),
            **({"stdin": DEVNULL, "stdout": DEVNULL} | streams | self.options),
        )
        try:
            yield process
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_GRACE_S):
                    await process.wait()

    async def do(
        self,
        job: object,
        progress: Callable[[Progress], None],
        *,
        held: Callable[[], bool] | None = None,
    ) -> Any:
        """Run a job (``app.runtime.jobs``) in a separate process; cancelling ends it.

        Args:
            progress: called in the event loop on every progress report.
            held: called ten times a second; returns whether the process must be suspended for now.

        Returns:
            The job's result.

        Raises:
            JobFailed: the job cannot be done.
        """
        async with AsyncExitStack() as stack:
            try:
                message = encode(job)
                starting = self.started(stdin=PIPE, stdout=PIPE)
                process = await stack.enter_async_context(starting)
            except (ChannelError, OSError) as error:
                raise JobFailed(f"the computation cannot be started: {error}") from error
            if held is None:
                return await _heard(process, message, progress)
            return await _heard_unless(_hold(process, held), _heard(process, message, progress))


async def _heard_unless(
    holding: Coroutine[Any, Any, None], hearing: Coroutine[Any, Any, Any]
) -> Any:
    """Return what is heard, unless holding fails: the process may then be suspended for ever.

    Raises:
        JobFailed: holding failed.
    """
    tasks = held, heard = asyncio.create_task(holding), asyncio.create_task(hearing)
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        if heard.done():
            return heard.result()
        error = held.exception()
        _log.error("it is unknown whether a computation must pause", exc_info=error)
        raise JobFailed(
            "the computation was ended because the server could not find out whether it must "
            "pause; start it again, or see the server's log"
        ) from error
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _hold(process: Process, held: Callable[[], bool]) -> None:
    """Suspend the process while it is held, and resume it afterwards."""
    paused = False
    while True:
        if held() != paused:
            paused = not paused
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGSTOP if paused else signal.SIGCONT)
        await asyncio.sleep(_HELD_S)


async def _heard(process: Process, message: bytes, progress: Callable[[Progress], None]) -> Any:
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(message)
    with contextlib.suppress(ConnectionError):
        await process.stdin.drain()
        process.stdin.close()
    try:
        while (heard := await read_message(process.stdout)) is not None:
            if isinstance(heard, Refused):
                raise JobFailed(heard.reason)
            if not isinstance(heard, Progress):
                return heard
            progress(heard)
    except ChannelError as error:
        raise JobFailed(
            f"the connection to the computation was lost: {error}; start it again"
        ) from error
    how = exit_words(await process.wait())
    raise JobFailed(
        f"the computation {how} without a result; start it again, or see the server's log"
    )


class LastingWorker:
    """Process that runs one job after another and may keep state; restarted if it is lost.

    One thread submits the jobs and waits for their results.

    Args:
        longest_s: a job that takes longer is abandoned, and the process with it.
    """

    def __init__(self, worker: Worker, *, longest_s: float) -> None:
        self._worker = worker
        self._longest_s = longest_s
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._ended = False

    def do(self, job: object, kind: type[_Result]) -> _Result | None:
        """Run a job and return its result, which must be of that type.

        Return None if the process was lost, took too long or was ended permanently. A lost process
        loses its state; the next job starts a new one.
        """
        # Writing to and reading from a stopped or hung process both block.
        patience = threading.Timer(self._longest_s, self._kill)
        patience.daemon = True
        patience.start()
        try:
            result = self._answered(encode(job))
        except (ChannelError, OSError) as error:
            _log.warning("%s cannot be used: %s", self._worker.module, error)
            result = None
        finally:
            patience.cancel()
        if isinstance(result, kind):
            return result
        # This also reaps a process that was killed between two jobs.
        self._let_go()
        return None

    def _answered(self, message: bytes) -> object:
        process = self._started()
        if process is None:
            return None
        assert process.stdin is not None
        assert process.stdout is not None
        with contextlib.suppress(BrokenPipeError):
            process.stdin.write(message)
            process.stdin.flush()
            return load_message(cast(BinaryIO, process.stdout))
        return None

    def end(self) -> None:
        """End the process permanently. Any thread may call this."""
        with self._lock:
            self._ended = True
        self._kill()

    def close(self) -> None:
        """End the process and wait for its end; for the thread that submits jobs."""
        self.end()
        self._let_go()

    def _started(self) -> subprocess.Popen[bytes] | None:
        with self._lock:
            if self._ended:
                return None
            if self._process is None:
                self._process = subprocess.Popen(
                    self._worker.command(), stdin=PIPE, stdout=PIPE, **self._worker.options
                )
            return self._process

    def _kill(self) -> None:
        with self._lock:
            if self._process is not None:
                with contextlib.suppress(ProcessLookupError):
                    self._process.kill()

    def _let_go(self) -> None:
        self._kill()
        with self._lock:
            process, self._process = self._process, None
        if process is None:
            return
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()
        how = exit_words(process.wait())
        if not self._ended:
            _log.warning(
                "%s was lost: it %s; the next job starts it again", self._worker.module, how
            )
