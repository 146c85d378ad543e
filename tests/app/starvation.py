"""A machine too busy for one process."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

# Processes per processor: enough to keep all busy, many times over.
_EACH = 8


@contextlib.contextmanager
def others_at_work(pid: int) -> Iterator[None]:
    """Let a process and its threads run only when no other wants to, and keep others busy."""
    command = [sys.executable, "-c", "while True: pass"]
    count = _EACH * len(os.sched_getaffinity(0))
    # Linux may give each session an equal share, whatever its processes do.
    hogs = [subprocess.Popen(command, start_new_session=True) for _ in range(count)]
    group, nice = Path(f"/proc/{pid}/autogroup"), "0"
    with contextlib.suppress(OSError):
        nice = group.read_text().split()[-1]
        group.write_text("19")
    try:
        for thread in Path(f"/proc/{pid}/task").iterdir():
            os.sched_setscheduler(int(thread.name), os.SCHED_IDLE, os.sched_param(0))
        yield
    finally:
        # The session may be that of the shell the tests were started from, and outlive them.
        with contextlib.suppress(OSError):
            group.write_text(nice)
        for hog in hogs:
            hog.kill()
        for hog in hogs:
            hog.wait()
