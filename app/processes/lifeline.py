"""A child process lives as long as its parent, and not a moment longer than it needs."""

from __future__ import annotations

import ctypes
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable

from app.channel.pipe import receive_message
from app.messages import Request

_PR_SET_PDEATHSIG = 1


def die_with_parent(parent_pid: int, by: signal.Signals = signal.SIGKILL) -> None:
    """Let the kernel end this process when the parent ends, where the kernel can (Linux).

    That also reaches a process that hangs inside a library call. Elsewhere the end of the channel
    has to do (``receive_until_parent_ends``).

    Args:
        by: SIGKILL reaches even a process that is stopped; a signal that can be answered leaves
            time to bring in order what outlasts the process.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, by)
    if os.getppid() != parent_pid:
        # It ended before the kernel was asked.
        os._exit(0)


def receive_until_parent_ends(
    sock: socket.socket,
    put: Callable[[Request], None],
    *,
    expects_end: Callable[[], bool],
    leave: Callable[[], object] = lambda: os._exit(0),
) -> threading.Thread:
    """Receive requests in a thread; at the channel's end leave, whatever the main loop does.

    The parent holds the other end, and however it ends, the kernel closes it.

    Args:
        put: takes each request.
        expects_end: True once the process leaves by itself.
        leave: called at the channel's end, in the thread. By default the process ends at once,
            without waiting for the main loop, which may hang.
    """

    def receive() -> None:
        while True:
            message = receive_message(sock)
            if message is None:
                break
            put(message)
        if not expects_end():
            leave()

    thread = threading.Thread(target=receive, name="message receiver", daemon=True)
    thread.start()
    return thread
