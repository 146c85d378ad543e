"""A TCP proxy that treats a stream as bad networks do."""

from __future__ import annotations

import random
import selectors
import socket
import struct
import threading
import time
from collections import deque

_CHUNK = 65536


class _Link:
    """One client's connection and the server's end of it."""

    def __init__(self, client: socket.socket, server: socket.socket) -> None:
        self.client = client
        self.server = server
        self.held: deque[tuple[float, bytes]] = deque()

    def close(self) -> None:
        for each in (self.client, self.server):
            each.close()


class FaultProxy:
    """Forwards a port of 127.0.0.1 to another and injects faults; use it as a context manager.

    Attributes:
        port: to connect to.
        target: port of the server; changing it affects new connections.
        stalled: True keeps connections, but forwards nothing.
        refused: True closes the listening port, so that connections are refused.
        delay_s: how long data from the server is held back.
        corrupted: share of the server's bytes that is replaced at random.
    """

    def __init__(self, target: int) -> None:
        self.target = target
        self.stalled = False
        self.delay_s = 0.0
        self.corrupted = 0.0
        self._refused = False
        self._chance = random.Random(1)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._links: list[_Link] = []
        self._lock = threading.Lock()
        self._ends = False
        self._thread = threading.Thread(target=self._run, name="fault proxy")

    def __enter__(self) -> FaultProxy:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends = True
        self._thread.join()
        self.cut()
        self._listener.close()

    @property
    def refused(self) -> bool:
        return self._refused

    @refused.setter
    def refused(self, refused: bool) -> None:
        with self._lock:
            if refused and not self._refused:
                self._listener.close()
            elif self._refused and not refused:
                self._listener = socket.create_server(("127.0.0.1", self.port))
            self._refused = refused

    def cut(self, *, reset: bool = False) -> None:
        """End all connections, with an end of stream or a reset."""
        with self._lock:
            for link in self._links:
                if reset:
                    now = struct.pack("ii", 1, 0)
                    link.client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, now)
                link.close()
            self._links.clear()

    def heal(self) -> None:
        """Remove all faults."""
        self.stalled, self.delay_s, self.corrupted, self.refused = False, 0.0, 0.0, False

    def _run(self) -> None:
        while not self._ends:
            with self._lock:
                self._step()
            time.sleep(0.001)

    def _step(self) -> None:
        with selectors.DefaultSelector() as selector:
            if not self._refused:
                selector.register(self._listener, selectors.EVENT_READ)
            if not self.stalled:
                for link in self._links:
                    selector.register(link.client, selectors.EVENT_READ, (link, True))
                    selector.register(link.server, selectors.EVENT_READ, (link, False))
            for key, _ in selector.select(0.0):
                if key.data is None:
                    self._accept()
                else:
                    self._forward(*key.data)
        for link in [] if self.stalled else list(self._links):
            self._deliver(link)

    def _accept(self) -> None:
        client, _ = self._listener.accept()
        try:
            server = socket.create_connection(("127.0.0.1", self.target), timeout=1.0)
        except OSError:
            client.close()
            return
        client.settimeout(0.5)
        self._links.append(_Link(client, server))

    def _forward(self, link: _Link, from_client: bool) -> None:
        if link not in self._links:
            return
        try:
            data = (link.client if from_client else link.server).recv(_CHUNK)
            if from_client and data:
                link.server.sendall(data)
                return
        except OSError:
            data = b""
        if not data:
            self._end(link)
            return
        link.held.append((time.monotonic() + self.delay_s, self._spoilt(data)))

    def _deliver(self, link: _Link) -> None:
        try:
            while link.held and link.held[0][0] <= time.monotonic():
                link.client.sendall(link.held.popleft()[1])
        except OSError:
            self._end(link)

    def _end(self, link: _Link) -> None:
        link.close()
        if link in self._links:
            self._links.remove(link)

    def _spoilt(self, data: bytes) -> bytes:
        if not self.corrupted:
            return data
        spoilt = bytearray(data)
        for _ in range(round(len(data) * self.corrupted) or 1):
            spoilt[self._chance.randrange(len(data))] = self._chance.randrange(256)
        return bytes(spoilt)
