"""A VRPN server of trackers over real TCP, modelled on the public library's, and its faults."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
import time
from collections.abc import Iterator, Sequence

from observer.truth.live.vrpn import (
    COOKIE_LENGTH,
    PING_TYPE,
    PONG_TYPE,
    POSE_TYPE,
    Conversation,
    Message,
    Sign,
    VrpnError,
    describe,
    pack,
)

from .mishaps import Sent

# As on a real server: type and sender numbers differ from ours, with others in between.
_TYPES = (
    "VRPN_Connection_Got_First_Connection",
    "VRPN_Connection_Got_Connection",
    "VRPN_Connection_Dropped_Connection",
    "VRPN_Connection_Dropped_Last_Connection",
    "vrpn_Base text_message",
    PING_TYPE,
    PONG_TYPE,
    POSE_TYPE,
    "vrpn_Tracker Velocity",
)
_CONTROL = "VRPN Control"


def pose_body(sensor: int, numbers: tuple[float, ...]) -> bytes:
    """The body of a pose: ``numbers`` are x, y, z, qx, qy, qz, qw."""
    return struct.pack(">ii7d", sensor, 0, *numbers)


class VrpnServer:
    """Serves any number of clients.

    Args:
        senders: names of trackers. port: 0: a free one. cookie: what it says first.
        piece: bytes a write, so that messages arrive split; None: as they are.
        answers: whether pings are answered.

    Attributes:
        port: where it listens. pinged, ponged: names of devices in the order of what came.
        cookies: what clients said first.
    """

    def __init__(
        self,
        senders: Sequence[str],
        *,
        port: int = 0,
        cookie: bytes = b"vrpn: ver. 07.35  0",
        piece: int | None = None,
        answers: bool = True,
    ) -> None:
        self._senders = [_CONTROL, *senders]
        self._cookie, self._piece, self.answers = cookie, piece, answers
        self._lock = threading.Lock()
        self._clients: list[socket.socket] = []
        self._threads: list[threading.Thread] = []
        self.pinged: list[str] = []
        self.ponged: list[str] = []
        self.cookies: list[bytes] = []
        self._listener = socket.create_server(("127.0.0.1", port))
        self.port: int = self._listener.getsockname()[1]
        self._thread = threading.Thread(target=self._accept, name="vrpn server", daemon=True)
        self._thread.start()

    @property
    def clients(self) -> int:
        """Return how many clients are connected and greeted."""
        with self._lock:
            return len(self._clients)

    def send(self, poses: list[Sent]) -> None:
        """Send one instant's poses to every client."""
        for each in poses:
            name, _, sensor = each.name.partition("/")
            self.say(POSE_TYPE, name, each.stamp, pose_body(int(sensor or 0), each.numbers))

    def say(self, type_: str, sender: str, stamp: float, body: bytes = b"") -> None:
        """Send any message to every client."""
        seconds = int(stamp)
        micros = min(999_999, int((stamp - seconds) * 1e6))
        number = self._senders.index(sender)
        message = Message(seconds % 2**32, micros, number, _TYPES.index(type_), body)
        self.raw(pack(message))

    def raw(self, data: bytes) -> None:
        """Send any bytes to every client."""
        with self._lock:
            clients = tuple(self._clients)
        for client in clients:
            self._write(client, data)

    def drop_clients(self) -> None:
        """End every connection; clients may reconnect."""
        with self._lock:
            clients, self._clients = tuple(self._clients), []
        for client in clients:
            with contextlib.suppress(OSError):
                client.shutdown(socket.SHUT_RDWR)

    def stop(self) -> None:
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        self._listener.close()
        self.drop_clients()
        for each in self._threads:
            each.join()

    # --- threads ------------------------------------------------------------------------------

    def _accept(self) -> None:
        while True:
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            thread = threading.Thread(target=self._serve, args=(client,), daemon=True)
            self._threads.append(thread)
            thread.start()

    def _serve(self, client: socket.socket) -> None:
        with client, contextlib.suppress(OSError, VrpnError):
            self._write(client, self._cookie.ljust(COOKIE_LENGTH, b"\0"))
            begin = b""
            while len(begin) < COOKIE_LENGTH:
                data = client.recv(COOKIE_LENGTH - len(begin))
                if not data:
                    return
                begin += data
            self.cookies.append(begin)
            # A UDP port where the sender would be; clients need not answer it.
            self._write(client, pack(Message(0, 0, 40_000, -3, b"127.0.0.1\0")))
            for kind, names in ((-1, self._senders), (-2, _TYPES)):
                for number, name in enumerate(names):
                    self._write(client, pack(describe(kind, number, name)))
            with self._lock:
                self._clients.append(client)
            try:
                self._hear(client)
            finally:
                with self._lock:
                    if client in self._clients:
                        self._clients.remove(client)

    def _hear(self, client: socket.socket) -> None:
        conversation = Conversation()
        while data := client.recv(4096):
            for told in conversation.feed(data):
                if not isinstance(told, Sign):
                    continue
                if told.type == PING_TYPE:
                    self.pinged.append(told.sender)
                    if self.answers:
                        number = self._senders.index(told.sender)
                        now = int(time.time())
                        pong = Message(now, 0, number, _TYPES.index(PONG_TYPE), b"")
                        self._write(client, pack(pong))
                else:
                    self.ponged.append(told.sender)

    def _write(self, client: socket.socket, data: bytes) -> None:
        piece = self._piece or len(data)
        # The thread that reads from a client notices when it is gone.
        with contextlib.suppress(OSError):
            for begin in range(0, len(data), piece):
                client.sendall(data[begin : begin + piece])


@contextlib.contextmanager
def deaf_host() -> Iterator[int]:
    """A port that neither accepts nor refuses connections, like a host that is switched off."""
    with socket.socket() as full:
        full.bind(("127.0.0.1", 0))
        full.listen(0)
        port = full.getsockname()[1]
        with contextlib.ExitStack() as stack:
            for _ in range(4):
                filler = stack.enter_context(socket.socket())
                filler.setblocking(False)
                with contextlib.suppress(BlockingIOError):
                    filler.connect(("127.0.0.1", port))
            yield port
