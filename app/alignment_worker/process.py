"""The engine's hold of the worker; all of it belongs to one thread but ``kill``."""

from __future__ import annotations

import contextlib
import os
import select
import subprocess
import sys
import threading
from typing import BinaryIO, cast

from app.alignment_worker.messages import Solve, Solved
from app.channel.pipe import encode, load_message
from app.native_environment import program_environment

# A solution takes seconds at most, also on a busy machine.
_LONGEST_S = 30.0
_COMMAND = (sys.executable, "-P", "-m", "app.alignment_worker")


class AlignmentWorker:
    """A process that is started with the first job, and anew where it was lost."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._ended = False

    def solve(self, job: Solve) -> Solved | None:
        """Have it align; waits for it.

        None where it was lost, took too long or is to be used no more. Lost, it has forgotten all;
        the next job begins with a new one.
        """
        process = self._started()
        if process is None:
            # Ended between two jobs, it was killed and nobody has waited for its end.
            self._let_go()
            return None
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            process.stdin.write(encode(job))
            process.stdin.flush()
            ready, _, _ = select.select([process.stdout], [], [], _LONGEST_S)
            solved = load_message(cast(BinaryIO, process.stdout)) if ready else None
        except OSError:
            solved = None
        if isinstance(solved, Solved):
            return solved
        self._let_go()
        return None

    def kill(self) -> None:
        """End what it does; the next job begins with a new one. Any thread may call."""
        with self._lock:
            if self._process is not None:
                with contextlib.suppress(ProcessLookupError):
                    self._process.kill()

    def end(self) -> None:
        """End it for good. Any thread may call."""
        with self._lock:
            self._ended = True
        self.kill()

    def close(self) -> None:
        """End it and wait for its end; for the thread that gives jobs."""
        self.end()
        self._let_go()

    def _started(self) -> subprocess.Popen[bytes] | None:
        with self._lock:
            if self._ended:
                return None
            if self._process is None:
                self._process = subprocess.Popen(
                    [*_COMMAND, str(os.getpid())],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    env=program_environment(),
                    # A terminal's Ctrl-C is the server's to answer.
                    start_new_session=True,
                )
            return self._process

    def _let_go(self) -> None:
        self.kill()
        with self._lock:
            process, self._process = self._process, None
        if process is None:
            return
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()
        process.wait()
