"""Process-level services of the kernel: an end with the parent, memory without a name.

Imports nothing slow: it is the first that a child process does.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import tempfile

_PR_SET_PDEATHSIG = 1


def die_with_parent(parent_pid: int, by: signal.Signals = signal.SIGKILL) -> None:
    """Let the kernel end this process when the parent ends, where the kernel can (Linux).

    That also reaches a process that hangs inside a library call. The kernel means the *thread*
    that started this process. Elsewhere the end of an inherited pipe or socket has to do.

    Args:
        by: SIGKILL reaches even a process that is stopped; a signal that can be answered leaves
            time to bring in order what outlasts the process.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, by)
    if os.getppid() != parent_pid:
        # It ended before the kernel was asked.
        os._exit(0)


def anonymous_memory(name: str) -> int:
    """Return the descriptor of an empty file in memory (elsewhere: on disk) without a path.

    Args:
        name: shown by the system's tools only.
    """
    if hasattr(os, "memfd_create"):
        return os.memfd_create(name, os.MFD_CLOEXEC)
    fd, path = tempfile.mkstemp()
    os.unlink(path)
    return fd
