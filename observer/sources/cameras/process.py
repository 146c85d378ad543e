"""The source's side of a camera's process."""

from __future__ import annotations

import mmap
import os
import subprocess
import sys
import threading

import numpy as np

from observer.processes import anonymous_memory
from observer.sources.cameras.messages import Command, Notice, Opened, decode_notice, encode
from observer.types import Image


class GrabberProcess:
    """A ``grabber`` process, started by the constructor; opens nothing yet. No call blocks.

    Raises:
        OSError: the system has no process or descriptor left.
    """

    def __init__(self) -> None:
        fds: list[int] = []
        try:
            fds += os.pipe()
            fds += os.pipe()
            fds.append(anonymous_memory("camera"))
            commands_in, self._commands, self.notices, notices_out, self._memory = fds
            # The kernel ends a process with the *thread* that started it; only the main thread
            # lives as long as its process.
            with_parent = threading.current_thread() is threading.main_thread()
            given = (commands_in, notices_out, self._memory)
            self.child = subprocess.Popen(
                [
                    *(sys.executable, "-P", "-m", "observer.sources.cameras.grabber"),
                    *map(str, (*given, os.getpid() if with_parent else 0)),
                ],
                pass_fds=given,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
        except BaseException:
            for fd in fds:
                os.close(fd)
            raise
        os.close(commands_in)
        os.close(notices_out)
        os.set_blocking(self._commands, False)
        os.set_blocking(self.notices, False)
        self._rest = b""
        # Last decoded image, set by ``map``: a view that changes with the next ``Decode``.
        self.image: Image
        self.ended = False

    def send(self, command: Command) -> None:
        """Send a command; a process that no longer reads is detected by its silence."""
        try:
            os.write(self._commands, encode(command))
        except (BlockingIOError, BrokenPipeError):
            return

    def receive(self) -> list[Notice]:
        """Return all notices since the last call; set ``ended`` where no more can come."""
        notices: list[Notice] = []
        while not self.ended:
            try:
                data = os.read(self.notices, 65536)
            except BlockingIOError:
                break
            if not data:
                self.ended = True
                break
            *lines, self._rest = (self._rest + data).split(b"\n")
            notices += [decode_notice(line) for line in lines]
        return notices

    def map(self, opened: Opened) -> None:
        """Map the memory into which it will decode images."""
        depth = (opened.channels,) if opened.channels > 1 else ()
        shape = (opened.height, opened.width, *depth)
        memory = mmap.mmap(self._memory, int(np.prod(shape)), prot=mmap.PROT_READ)
        self.image = np.frombuffer(memory, np.uint8).reshape(shape)

    def kill(self) -> subprocess.Popen[bytes]:
        """End it and release all it used; return the process to wait for."""
        self.child.kill()
        self.ended = True
        for fd in (self._commands, self.notices, self._memory):
            os.close(fd)
        return self.child
