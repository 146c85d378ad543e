"""CPU time that another process wants and gets, read from Linux's ``/proc``.

On an overloaded machine a healthy process may be silent for seconds because it waits for a core.
A check that judges a process by its silence must discount that time.
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

# Fields after the name in ``/proc/PID/stat``: the state, and the time used in user and kernel
# mode, in clock ticks (man 5 proc).
_STATE, _USER, _SYSTEM = 0, 11, 12
_RUNNABLE = "R"


class ProcessorTime:
    """CPU time of one process; safe to query after its end.

    Args:
        pid: process id.
    """

    def __init__(self, pid: int) -> None:
        self._folder = Path("/proc") / str(pid)
        self._used_s: float | None = None

    def restart(self) -> None:
        """Forget the CPU time measured so far."""
        self._used_s = None

    def could_use(self, passed_s: float) -> float:
        """Return how much of the last ``passed_s`` seconds the process was able to run.

        All of it if the process sleeps or nothing is known; if it runs or waits for a core, the
        CPU time that it got since the last call.
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
        """Return whether any of its threads runs or waits for a core."""
        for thread in (self._folder / "task").iterdir():
            # A thread may end in the meantime.
            with contextlib.suppress(OSError):
                if _fields(thread / "stat")[_STATE] == _RUNNABLE:
                    return True
        return False


def _fields(file: Path) -> list[str]:
    # The name is in parentheses and may itself contain parentheses and spaces.
    return file.read_text().rpartition(")")[2].split()
