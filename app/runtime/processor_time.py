"""Processor time that another process wants and gets, by Linux's ``/proc``.

On a machine with too much to do a process may be silent for seconds though nothing is wrong with
it: it waits for its turn. Whoever judges it by its silence counts that time for less.
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

# Fields behind the name in ``/proc/PID/stat``: the state, and the time used in user and kernel
# mode, in clock ticks (man 5 proc).
_STATE, _USER, _SYSTEM = 0, 11, 12
_RUNNABLE = "R"


class ProcessorTime:
    """What one process gets; safe to ask after its end.

    Args:
        pid: of the process.
    """

    def __init__(self, pid: int) -> None:
        self._folder = Path("/proc") / str(pid)
        self._used_s: float | None = None

    def restart(self) -> None:
        """Forget what was used before."""
        self._used_s = None

    def could_use(self, passed_s: float) -> float:
        """Return for how long of the last ``passed_s`` seconds the process could go on.

        All of it while it sleeps, or where nothing is known; while it runs or waits for a
        processor, the time that it was given since the last call.
        """
        try:
            used_s = self._read_used()
            wants = self._wants()
        except (OSError, ValueError, IndexError):
            return passed_s
        before, self._used_s = self._used_s, used_s
        if before is None or not wants:
            return passed_s
        return min(passed_s, used_s - before)

    def _read_used(self) -> float:
        fields = _fields(self._folder / "stat")
        return (int(fields[_USER]) + int(fields[_SYSTEM])) / os.sysconf("SC_CLK_TCK")

    def _wants(self) -> bool:
        """Return whether any of its threads runs or waits for a processor."""
        for thread in (self._folder / "task").iterdir():
            # A thread may end meanwhile.
            with contextlib.suppress(OSError):
                if _fields(thread / "stat")[_STATE] == _RUNNABLE:
                    return True
        return False


def _fields(file: Path) -> list[str]:
    # The name is in brackets and may hold anything, brackets and blanks included.
    return file.read_text().rpartition(")")[2].split()
