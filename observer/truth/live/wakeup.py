"""Waiting for a socket in a way that another thread can end at once."""

from __future__ import annotations

import contextlib
import selectors
import socket
import threading


class Wakeup:
    """Ends every wait of one thread when another says so."""

    def __init__(self) -> None:
        self._ended = threading.Event()
        self._woken, self._waker = socket.socketpair()
        self._waker.setblocking(False)

    @property
    def ended(self) -> bool:
        return self._ended.is_set()

    def end(self) -> None:
        """From any thread; safe to call twice."""
        self._ended.set()
        with contextlib.suppress(OSError):
            self._waker.send(b"!")

    def wait(self, timeout_s: float, to_read: socket.socket, *, to_write: bool = False) -> bool:
        """Whether the socket is ready; False after the time is over or ``end`` was called."""
        with selectors.DefaultSelector() as selector:
            wanted = selectors.EVENT_WRITE if to_write else selectors.EVENT_READ
            selector.register(to_read, wanted)
            selector.register(self._woken, selectors.EVENT_READ)
            ready = selector.select(timeout_s)
        return not self.ended and any(key.fileobj is to_read for key, _ in ready)

    def pause(self, seconds: float) -> None:
        """Nothing for so long, or until ``end``."""
        self._ended.wait(seconds)

    def close(self) -> None:
        """Only the thread that waits, at its end."""
        self._woken.close()
        self._waker.close()
