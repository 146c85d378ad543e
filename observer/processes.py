"""Process-level services of the kernel: termination with the parent, anonymous memory.

Imports nothing slow, because child processes import it first.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import tempfile

_PR_SET_PDEATHSIG = 1


def die_with_parent(parent_pid: int, by: signal.Signals = signal.SIGKILL) -> None:
    """Let the kernel end this process when the parent ends, if the kernel supports it (Linux).

    This also works for a process that hangs inside a library call. To the kernel, the parent is
    the *thread* that started this process. On other systems, detecting the end of an inherited
    pipe or socket has to suffice.

    Args:
        by: SIGKILL ends even a stopped process; a signal that can be handled leaves time to clean
            up what outlives the process.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, by)
    if os.getppid() != parent_pid:
        # The parent ended before the request took effect.
        os._exit(0)


def anonymous_memory(name: str) -> int:
    """Return the descriptor of an empty file without a path, in memory (or on disk if unsupported).

    Args:
        name: shown by the system's tools only.
    """
    if hasattr(os, "memfd_create"):
        return os.memfd_create(name, os.MFD_CLOEXEC)
    fd, path = tempfile.mkstemp()
    os.unlink(path)
    return fd
