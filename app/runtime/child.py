"""Parent's handle on one child process: start it, listen to it, query it, end it.

The web process imports this, so it imports nothing of the method.
"""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from app.runtime.arguments import ProcessArguments
from app.runtime.environment import program_environment
from app.runtime.errors import ChannelError
from app.runtime.pipe import encode, read_message
from app.runtime.processor_time import ProcessorTime
from app.runtime.requests import Reply, Request

# Time for a process to exit after it closed its channel or was killed.
_GRACE_S = 0.3
# Silence after which the process's CPU time is read, which takes a millisecond.
_LOOK_AFTER_S = 0.3
_log = logging.getLogger(__name__)

_Event = TypeVar("_Event")


class ChildEnded(Exception):
    """End of a process before it replied."""


class ChildProcess:
    """Child process. Call all methods in the event loop's thread.

    Attributes:
        ready: it has sent something, so its loop runs.
        ended: its channel is closed; the process is gone or about to go.
        silent_s: seconds without a message, counting only the time in which this event loop could
            receive one and the process had CPU time to send one. unheard_s: the same, but whether
            or not the process had CPU time.
    """

    def __init__(
        self,
        process: subprocess.Popen[bytes],
        kept: Sequence[type],
        on_event: Callable[[Any], None],
    ) -> None:
        self._process = process
        self._kept = tuple(kept)
        self._on_event = on_event
        self._writer: asyncio.StreamWriter | None = None
        self._reading: asyncio.Task[None] | None = None
        self._waiting: dict[int, asyncio.Future[Reply]] = {}
        self._newest: dict[type, Any] = {}
        self._number = 0
        self.started = time.monotonic()
        self.ready = False
        self.ended = False
        self.silent_s = self.unheard_s = 0.0
        self._processor = ProcessorTime(process.pid)

    @classmethod
    async def start(
        cls,
        command: Sequence[str],
        slots: Mapping[str, int],
        on_event: Callable[[ChildProcess, Any], None],
        kept: Sequence[type] = (),
    ) -> ChildProcess:
        """Start a process; it inherits nothing but its channel and the slots.

        The kernel ends it with the *thread* that calls this, so call it in the event loop's thread.

        Args:
            command: command that starts it; its arguments are appended.
            slots: descriptor of each latest-value slot by name.
            on_event: called with the process and each event from it, and with None in place of the
                event when the channel ends.
            kept: types of event whose last instance ``newest`` returns.

        Raises:
            OSError: it cannot be started.
        """
        here, there = socket.socketpair()
        with there:
            arguments = ProcessArguments(there.fileno(), os.getpid(), slots).as_command_line()
            try:
                process = subprocess.Popen(
                    [*command, *arguments],
                    stdin=subprocess.DEVNULL,
                    pass_fds=[there.fileno(), *slots.values()],
                    env=program_environment(),
                    # Only the parent receives a terminal's Ctrl-C or a kill of the process group;
                    # it then shuts this process down in order.
                    start_new_session=True,
                )
            except BaseException:
                here.close()
                raise
        child = cls(process, kept, lambda event: on_event(child, event))
        try:
            reader, child._writer = await asyncio.open_unix_connection(sock=here)
        except BaseException:
            here.close()
            process.kill()
            process.wait()
            raise
        child._reading = asyncio.create_task(child._read(reader), name="hear a process")
        return child

    @property
    def pid(self) -> int:
        return self._process.pid

    def newest(self, kind: type[_Event]) -> _Event | None:
        """Return the newest event of a type in ``kept``."""
        event = self._newest.get(kind)
        return event if isinstance(event, kind) else None

    def stay_silent(self, passed_s: float) -> None:
        """Add time in which no message came from the process."""
        self.unheard_s += passed_s
        if self.unheard_s < _LOOK_AFTER_S:
            self._processor.restart()
            self.silent_s = self.unheard_s
        else:
            self.silent_s += self._processor.could_use(passed_s)

    async def _read(self, reader: asyncio.StreamReader) -> None:
        try:
            while (message := await read_message(reader)) is not None:
                self.ready = True
                self.silent_s = self.unheard_s = 0.0
                if isinstance(message, Reply):
                    waiting = self._waiting.pop(message.number, None)
                    if waiting is not None and not waiting.done():
                        waiting.set_result(message)
                    continue
                if isinstance(message, self._kept):
                    self._newest[type(message)] = message
                self._on_event(message)
        except ChannelError as error:
            _log.error("lost contact with process %d: %s", self.pid, error)
        except Exception:  # noqa: BLE001
            # Nobody waits for this task; a process that is not listened to is replaced.
            _log.exception("a message from process %d cannot be handled", self.pid)
        finally:
            self.ended = True
            for waiting in self._waiting.values():
                if not waiting.done():
                    waiting.set_exception(ChildEnded())
            self._waiting.clear()
        self._on_event(None)

    async def request(self, command: object, timeout_s: float) -> Reply:
        """Send a request and wait for the reply.

        Raises:
            ChildEnded: the process ended before it replied.
            TimeoutError: it did not reply in time; a later reply is ignored.
        """
        if self.ended or self._writer is None:
            raise ChildEnded
        self._number += 1
        number = self._number
        waiting: asyncio.Future[Reply] = asyncio.get_running_loop().create_future()
        self._waiting[number] = waiting
        try:
            self._writer.write(encode(Request(number, command)))
            async with asyncio.timeout(timeout_s):
                return await waiting
        finally:
            self._waiting.pop(number, None)

    def terminate(self) -> None:
        """Send SIGTERM; do nothing if the process is gone already."""
        self._process.terminate()

    def kill(self) -> None:
        """Send SIGKILL, which also ends a stopped process; do nothing if it is gone already."""
        self._process.kill()

    async def wait_gone(self, timeout_s: float) -> bool:
        """Wait for at most ``timeout_s``; return true if the process is gone."""
        until = time.monotonic() + timeout_s
        while self._process.poll() is None:
            if time.monotonic() >= until:
                return False
            await asyncio.sleep(0.005)
        return True

    def reap(self) -> bool:
        """Return true if the process is gone, and reap it; nothing of it then remains."""
        return self._process.poll() is not None

    async def remove(self) -> str:
        """End the process, by force if necessary, and stop listening to it; return how it ended.

        A process that is stuck inside the kernel (a camera driver that does not return) outlasts
        this; call ``reap`` until it is gone. Once killed, it executes no more of our code.
        """
        if not (self.ended and await self.wait_gone(_GRACE_S)):
            self.kill()
            await self.wait_gone(_GRACE_S)
        if self._reading is not None:
            self._reading.cancel()
            await asyncio.gather(self._reading, return_exceptions=True)
        if self._writer is not None:
            self._writer.transport.abort()
        return exit_words(self._process.returncode)


def exit_words(code: int | None) -> str:
    """Describe how a process ended, given its return code, or None if it has not ended."""
    if code is None:
        return "hangs in the kernel and cannot be terminated yet"
    if code < 0:
        try:
            return f"ended by {signal.Signals(-code).name}"
        except ValueError:
            return f"ended by signal {-code}"
    return f"ended with exit code {code}"
