"""Heavy work on runs, done by commands in separate processes, never in the server's own."""

from __future__ import annotations

import asyncio
import os
import secrets
import shutil
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path

import structlog

from app.runtime.child import exit_words
from app.runtime.worker import Worker
from app.server.data_files import storage_errors
from app.server.errors import NotAvailable
from app.storage import DataFolder, StorageFull
from observer.errors import DynamicObserverError

log = structlog.get_logger(__name__)

# Lower priority than the engine and the drive process, whose loops the work must not disturb.
_NICENESS = 15
_CLI = "app.cli"
# Exit codes of a command that refuses and gives the reason in one sentence.
_REFUSALS = (1, 2)
_SAYS = "dynamic-observer: "
_WORK = ".work-"
_MOST_WAITING = 8
# With less free space than this, a failed write counts as a full disk.
_FULL_BYTES = 1 << 20
_LOGGED = 2000


class CommandRefused(DynamicObserverError):
    """Refusal by a command to do its work on this run; the sentence is the command's own."""


class RunCommands:
    """Runs one command after the other; each ends when nothing waits for it any more.

    Args:
        folder: the data folder, which holds the files while they are being made.
        time_limit_s: a command that takes longer is terminated.
    """

    def __init__(self, folder: DataFolder, *, time_limit_s: float) -> None:
        self._folder = folder
        self._time_limit_s = time_limit_s
        self._one = asyncio.Lock()
        self._waiting = 0

    async def run(self, *words: str, module: str = _CLI) -> None:
        """Run a command to its end; cancelling terminates it.

        Args:
            words: words of the command line. module: module to run, as with ``python -m``.

        Raises:
            CommandRefused: the command refused. StorageFull: the disk is full.
            NotAvailable: the command failed, took too long, or too many are waiting already.
        """
        if self._waiting >= _MOST_WAITING:
            raise NotAvailable(
                "too many files are already being generated from runs; try again later"
            )
        self._waiting += 1
        try:
            async with self._one:
                await self._run(module, words)
        except CommandRefused as error:
            if await asyncio.to_thread(self._folder.free_bytes) < _FULL_BYTES:
                raise StorageFull("no space is left for the file; free some disk space") from error
            raise
        finally:
            self._waiting -= 1

    @asynccontextmanager
    async def folder(self) -> AsyncIterator[Path]:
        """Yield an empty folder, which is deleted with its contents after the block.

        Raises:
            StorageFull, FieldError: it cannot be created.
        """
        path = self._folder.path.absolute() / f"{_WORK}{os.getpid()}-{secrets.token_hex(6)}"
        with storage_errors(path):
            await asyncio.to_thread(path.mkdir, parents=True)
        try:
            yield path
        finally:
            await asyncio.shield(asyncio.to_thread(shutil.rmtree, path, ignore_errors=True))

    def tidy(self) -> None:
        """Delete the unfinished files of servers that no longer run."""
        for path in self._folder.path.glob(f"{_WORK}*-*"):
            pid = path.name.removeprefix(_WORK).partition("-")[0]
            if not (pid.isdigit() and _is_alive(int(pid))):
                shutil.rmtree(path, ignore_errors=True)

    async def _run(self, module: str, words: Sequence[str]) -> None:
        name = words[0] if module == _CLI else module
        worker = Worker(module, _NICENESS)
        try:
            async with (
                worker.started(*words, stderr=asyncio.subprocess.PIPE) as process,
                asyncio.timeout(self._time_limit_s),
            ):
                _, said = await process.communicate()
        except TimeoutError:
            raise NotAvailable(
                f"the command {name} took longer than {self._time_limit_s:.0f} s and was stopped"
            ) from None
        except OSError as error:
            raise NotAvailable(f"the command {name} cannot be started: {error}") from error
        if process.returncode:
            raise _error(name, process.returncode, said.decode("utf-8", "replace"))


def _error(name: str, code: int, said: str) -> DynamicObserverError:
    lines = said.strip().splitlines()
    if code in _REFUSALS and lines and lines[-1].startswith(_SAYS):
        return CommandRefused(lines[-1].removeprefix(_SAYS))
    log.error("command_failed", command=name, code=code, said=said[-_LOGGED:])
    return NotAvailable(
        f"the command {name} {exit_words(code)}, without a result; see the server's log"
    )


def _is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    return True
