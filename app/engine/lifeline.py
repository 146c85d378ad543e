"""The engine lives as long as its parent, and not a moment longer."""

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


def die_with_parent(parent_pid: int) -> None:
    """Let the kernel end this process when the parent ends, where the kernel can (Linux).

    That also reaches an engine that is stopped or hangs inside a library call. Elsewhere the end
    of the channel has to do (``receive_until_parent_ends``).
    """
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent_pid:
        # It ended before the kernel was asked.
        os._exit(0)


def receive_until_parent_ends(
    sock: socket.socket, put: Callable[[Request], None], *, expects_end: Callable[[], bool]
) -> threading.Thread:
    """Receive requests in a thread; at the channel's end leave at once, whatever the loop does.

    The parent holds the other end, and however it ends, the kernel closes it. Leaving does not
    wait for the main loop, which may hang.

    Args:
        put: takes each request.
        expects_end: True once the engine leaves by itself.
    """

    def receive() -> None:
        while True:
            message = receive_message(sock)
            if message is None:
                break
            put(message)
        if not expects_end():
            os._exit(0)

    thread = threading.Thread(target=receive, name="message receiver", daemon=True)
    thread.start()
    return thread
