"""Connections that have not signed in: few at a time, and not for long.

A person who presses Stop needs a file descriptor and an answer, whatever others do to the port. So
a connection that sends no request, or was answered without signing in, counts as a stranger's; to
let another one in, the oldest of the address with the most of them is ended.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
import weakref
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

# Browsers open a handful of connections before they send a request.
_MOST = 100
# A request's head is a few hundred bytes.
_WITHIN_S = 10.0
_LOOK_EVERY_S = 1.0

# Key of a request's state that the gate sets once a token was right.
SIGNED_IN = "signed_in"


@dataclass(eq=False)
class _Known:
    """Connection, the address it came from, and since when it has been idle."""

    connection: weakref.ref[socket.socket]
    address: str
    since: float


class Strangers:
    """Keeps account of connections by their descriptors; used in the event loop.

    Args:
        clock: monotonic seconds. most: allowed at a time. within_s: idle time until each is ended.
    """

    def __init__(
        self, clock: Callable[[], float], *, most: int = _MOST, within_s: float = _WITHIN_S
    ) -> None:
        self._clock = clock
        self._most, self._within_s = most, within_s
        # The longest waiting first.
        self._waiting: dict[int, _Known] = {}
        # Being served, or signed in.
        self._others: dict[int, _Known] = {}

    @property
    def count(self) -> int:
        """Return the number of strangers that are connected and idle."""
        self._forget_closed()
        return len(self._waiting)

    def come(self, connection: socket.socket, address: str) -> None:
        """Register a new connection."""
        number = connection.fileno()
        self._others.pop(number, None)
        self._waiting.pop(number, None)
        self._waiting[number] = _Known(weakref.ref(connection), address, self._clock())

    def asked(self, number: int) -> None:
        """Note that a request of this connection is being answered."""
        known = self._waiting.pop(number, None)
        if known is not None:
            self._others[number] = known

    def answered(self, number: int, *, signed_in: bool) -> None:
        """Note that the answer was sent; a connection that is not signed in waits again."""
        if not signed_in and (known := self._others.pop(number, None)) is not None:
            known.since = self._clock()
            self._waiting[number] = known

    def make_room(self) -> bool:
        """Return whether there is room for another one; if not, end one to make room."""
        if len(self._waiting) < self._most or self.count < self._most:
            return True
        busiest = Counter(each.address for each in self._waiting.values()).most_common(1)[0][0]
        self._end(next(n for n, each in self._waiting.items() if each.address == busiest))
        return False

    def sweep(self) -> None:
        """End those that have been idle for too long."""
        self._forget_closed()
        latest = self._clock() - self._within_s
        for number in [n for n, each in self._waiting.items() if each.since < latest]:
            self._end(number)

    async def watch(self) -> None:
        """Sweep periodically, until cancelled."""
        while True:
            await asyncio.sleep(_LOOK_EVERY_S)
            self.sweep()

    def _end(self, number: int) -> None:
        connection = self._waiting.pop(number).connection()
        # Its transport then reads the end of the stream and closes it.
        if connection is not None:
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)

    def _forget_closed(self) -> None:
        for connections in (self._waiting, self._others):
            for number in [n for n, each in connections.items() if _is_closed(each)]:
                del connections[number]


def _is_closed(known: _Known) -> bool:
    connection = known.connection()
    return connection is None or connection.fileno() < 0


class GuardedListener(socket.socket):
    """TCP socket that accepts no more strangers than there is room for.

    Attributes:
        strangers: registers each connection that it accepts.
    """

    def __init__(self, strangers: Strangers, family: int = socket.AF_INET) -> None:
        # asyncio sets TCP_NODELAY only if the protocol is named.
        super().__init__(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
        self.strangers = strangers

    def accept(self) -> tuple[socket.socket, Any]:
        """Accept a connection.

        Raises:
            BlockingIOError: there is none, or one must be ended first: the event loop retries.
        """
        if not self.strangers.make_room():
            raise BlockingIOError
        connection, address = super().accept()
        self.strangers.come(connection, str(address[0]))
        return connection, address


def guarded_protocol(strangers: Strangers) -> type[H11Protocol]:
    """Return uvicorn's HTTP protocol, extended to report requests and answers to ``strangers``."""

    class GuardedProtocol(H11Protocol):
        _number = -1

        def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
            super().connection_made(transport)
            self._number = transport.get_extra_info("socket").fileno()

        def data_received(self, data: bytes) -> None:
            super().data_received(data)
            if self.cycle is not None and not self.cycle.response_complete:
                strangers.asked(self._number)

        def handle_websocket_upgrade(self, event: Any) -> None:
            strangers.asked(self._number)
            super().handle_websocket_upgrade(event)

        def on_response_complete(self) -> None:
            super().on_response_complete()
            signed_in = bool(self.scope.get("state", {}).get(SIGNED_IN, False))
            strangers.answered(self._number, signed_in=signed_in)

    return GuardedProtocol
