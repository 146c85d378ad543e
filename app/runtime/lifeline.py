"""Ends a child process when its channel closes because the parent is gone.

This complements ``die_with_parent``.
"""

from __future__ import annotations

import logging
import os
import socket
import threading
from collections.abc import Callable

from app.runtime.errors import ChannelError
from app.runtime.pipe import load_message
from app.runtime.requests import Request

_log = logging.getLogger(__name__)


def receive_until_parent_ends(
    sock: socket.socket,
    put: Callable[[Request], None],
    *,
    expects_end: Callable[[], bool],
    leave: Callable[[], object] = lambda: os._exit(0),
) -> None:
    """Receive requests in a thread; leave at the channel's end, whatever the main loop does.

    The parent holds the other end, and however the parent ends, the kernel closes it. A damaged
    message is the channel's end as well.

    Args:
        put: takes each request.
        expects_end: returns true once the process is leaving by itself.
        leave: called at the channel's end, in the thread. By default the process ends at once,
            without waiting for the main loop, which may hang.
    """

    def receive() -> None:
        stream = sock.makefile("rb")
        try:
            while (message := load_message(stream)) is not None:
                put(message)
        except ChannelError as error:
            # Without its channel the process would run on and never receive a request.
            _log.error("lost contact with the server: %s", error)
        if not expects_end():
            leave()

    threading.Thread(target=receive, name="message receiver", daemon=True).start()
