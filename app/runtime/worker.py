"""Handle of a worker: one of our modules in a process that yields to others and ends with this one.

A job is given up by ending its worker: no step inside a native library can be interrupted.
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
from collections.abc import AsyncIterator, Callable, Mapping
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
        niceness: added to this process's.
        environment: additions to that of every process that we start.
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
        """Return the keywords for the function that starts a process."""
        # The server handles a terminal's Ctrl-C.
        return {"env": {**program_environment(), **self.environment}, "start_new_session": True}

    @asynccontextmanager
    async def started(self, *arguments: str, **streams: int) -> AsyncIterator[Process]:
        """Start a process; end it after the block, together with all that it started.

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
            held: asked ten times a second whether the process has to stand still for now.

        Returns:
            The job's result.

        Raises:
            JobFailed: it cannot be done.
        """
        async with AsyncExitStack() as stack:
            try:
                message = encode(job)
                starting = self.started(stdin=PIPE, stdout=PIPE)
                process = await stack.enter_async_context(starting)
            except (ChannelError, OSError) as error:
                raise JobFailed(f"the computation cannot be started: {error}") from error
            if held is not None:
                holding = asyncio.create_task(_hold(process, held))
                stack.callback(holding.cancel)
            return await _heard(process, message, progress)


async def _hold(process: Process, held: Callable[[], bool]) -> None:
    """Stop the process whenever it is held, and let it go on afterwards."""
    stands = False
    while True:
        if held() != stands:
            stands = not stands
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGSTOP if stands else signal.SIGCONT)
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
    """Process that does job after job and may keep state; started anew where it was lost.

    One thread gives the jobs and waits for their results.

    Args:
        longest_s: a job that takes longer is given up, and the process with it.
    """

    def __init__(self, worker: Worker, *, longest_s: float) -> None:
        self._worker = worker
        self._longest_s = longest_s
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._ended = False

    def do(self, job: object, kind: type[_Result]) -> _Result | None:
        """Run a job with a result of that kind.

        None where the process was lost, took too long or must not be used any more. A lost process
        has forgotten everything; the next job begins with a new one.
        """
        # Writing and reading both wait for a process that is stopped or hangs.
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
        # Also of a process that was ended between two jobs: killed, but not yet waited for.
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
        """End the process for good. Any thread may call this."""
        with self._lock:
            self._ended = True
        self._kill()

    def close(self) -> None:
        """End the process and wait for its end; for the thread that gives jobs."""
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
