"""Client of a VRPN server's trackers over TCP: one thread owns the connection and reconnects.

We open the connection ourselves (as the library does for ``tcp://`` addresses) and announce no
UDP port, so the server sends everything over this connection.
"""

from __future__ import annotations

import contextlib
import errno
import math
import os
import socket
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from observer.geometry import Float64Array
from observer.truth.live.heard import LiveCapture
from observer.truth.live.intake import Intake
from observer.truth.live.vrpn import (
    COOKIE,
    COOKIE_LENGTH,
    PING_TYPE,
    PONG_TYPE,
    Conversation,
    Speaker,
    TrackerPose,
    VrpnError,
    check_cookie,
)

_CONNECT_WITHIN_S = 3.0
_COOKIE_WITHIN_S = 3.0
_CHUNK = 64 * 1024
# Seconds: a silent server is pinged once per second, and given up if it stays silent.
_ASK_AFTER_S = 3.0
_ASK_EVERY_S = 1.0
_GIVE_UP_AFTER_S = 13.0
# TCP keepalive, to detect a dead host: seconds, seconds, count.
_KEEPALIVE = (("TCP_KEEPIDLE", 5), ("TCP_KEEPINTVL", 2), ("TCP_KEEPCNT", 3))


class _Lost(Exception):
    """The connection failed or was lost; one sentence."""


class VrpnCapture(LiveCapture):
    """Trackers of a VRPN server.

    A body is a sender's sensor: sensor 0 is named like the sender, others ``SENDER/SENSOR``.

    Args:
        host, port: of the server. names: bodies or senders wanted; empty for all.
        spec: as opened. clock: host's monotonic clock.
    """

    def __init__(
        self,
        host: str,
        port: int,
        names: Sequence[str] = (),
        *,
        spec: str,
        clock: Callable[[], float],
    ) -> None:
        self._host, self._port, self._names = host, port, frozenset(names)
        self._where = f"{host}:{port}"
        super().__init__(Intake(clock), spec=spec, name=f"vrpn {self._where}", clock=clock)

    def _listened(self) -> str | None:
        try:
            with self._connected() as connection:
                self._listen(connection)
        except (_Lost, VrpnError, OSError) as error:
            if isinstance(error, VrpnError):
                self._intake.malformed()
            why = _reason(error) if isinstance(error, OSError) else error
            return f"the VRPN server at {self._where} cannot be used: {why}"
        return None

    @contextlib.contextmanager
    def _connected(self) -> Iterator[socket.socket]:
        """Provide a connection to the first address that answers."""
        try:
            found = socket.getaddrinfo(self._host, self._port, type=socket.SOCK_STREAM)
        except (OSError, UnicodeError):
            raise _Lost("no host of this name is known") from None
        error = _Lost("its host has no address")
        for family, kind, protocol, _, address in found:
            try:
                opened = socket.socket(family, kind, protocol)
            except OSError as refused:
                # The system may not support this address's family.
                error = _Lost(_reason(refused))
                continue
            with opened as connection:
                try:
                    self._connect(connection, address)
                except _Lost as lost:
                    error = lost
                    continue
                yield connection
                return
        raise error

    def _connect(self, connection: socket.socket, address: object) -> None:
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for name, value in _KEEPALIVE:
            # Not every system has all of them.
            if hasattr(socket, name):
                connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)
        try:
            connection.connect(address)  # type: ignore[arg-type]
        except BlockingIOError:
            if not self._wakeup.wait(_CONNECT_WITHIN_S, connection, to_write=True):
                raise _Lost(f"it did not answer within {_CONNECT_WITHIN_S:g} s") from None
        except OSError as error:
            raise _Lost(_reason(error)) from error
        failed = connection.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if failed:
            raise _Lost(_reason(OSError(failed, "")))

    def _listen(self, connection: socket.socket) -> None:
        """Listen until the connection is lost or ended.

        Raises:
            _Lost, VrpnError: why it ended.
        """
        self._send(connection, COOKIE)
        rest = self._cookies(connection)
        self._intake.connected()
        conversation, speaker = Conversation(), Speaker()
        heard = asked = self._clock()
        data, received = rest, heard
        while not self._wakeup.ended:
            for message in conversation.feed(data):
                if isinstance(message, TrackerPose):
                    self._pose(message, received)
                elif message.type == PING_TYPE:
                    self._send(connection, speaker.say(PONG_TYPE, message.sender))
            if not self._wakeup.wait(_ASK_EVERY_S, connection):
                data = b""
                now = self._clock()
                # A server that described no device cannot answer pings; rely on TCP keepalive.
                if conversation.senders and now - heard > _GIVE_UP_AFTER_S:
                    raise _Lost(f"it has sent nothing for {_GIVE_UP_AFTER_S:g} s")
                if now - heard > _ASK_AFTER_S and now - asked >= _ASK_EVERY_S:
                    asked = now
                    for sender in conversation.senders:
                        self._send(connection, speaker.say(PING_TYPE, sender))
                continue
            data = self._receive(connection)
            # Take the time after the read: if preempted between them, a time taken before it
            # would be earlier than the sending of the data.
            received = heard = self._clock()

    def _cookies(self, connection: socket.socket) -> bytes:
        """Read the other side's cookie; return the bytes after it."""
        data = b""
        until = self._clock() + _COOKIE_WITHIN_S
        while len(data) < COOKIE_LENGTH:
            left = until - self._clock()
            if left <= 0 or not self._wakeup.wait(left, connection):
                raise _Lost(f"it did not identify itself within {_COOKIE_WITHIN_S:g} s")
            data += self._receive(connection)
        other = check_cookie(data[:COOKIE_LENGTH])
        if other is not None:
            self._intake.note("version", other)
        return data[COOKIE_LENGTH:]

    def _receive(self, connection: socket.socket) -> bytes:
        try:
            data = connection.recv(_CHUNK)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise _Lost(_reason(error)) from error
        if not data:
            raise _Lost("it closed the connection")
        return data

    def _send(self, connection: socket.socket, data: bytes) -> None:
        try:
            # At most a few bytes per second: if they do not fit, the other side does not read.
            if connection.send(data) < len(data):
                raise _Lost("it no longer accepts data")
        except OSError as error:
            raise _Lost(_reason(error)) from error

    def _pose(self, pose: TrackerPose, received: float) -> None:
        name = f"{pose.sender}/{pose.sensor}" if pose.sensor else pose.sender
        if self._names and not self._names & {name, pose.sender}:
            return
        self._intake.pose(
            name,
            pose.time,
            received,
            (*pose.position, *pose.quaternion),
            np.array(pose.position),
            _rotation(pose.quaternion),
        )


def _rotation(quaternion: tuple[float, float, float, float]) -> Float64Array | None:
    """Return the rotation (3, 3) of x, y, z, w; None if it is far from a unit quaternion."""
    if not 0.9 < math.hypot(*quaternion) < 1.1:
        return None
    return np.asarray(Rotation.from_quat(quaternion).as_matrix())


def _reason(error: OSError) -> str:
    if error.errno == errno.ECONNREFUSED:
        return "nothing listens there"
    return os.strerror(error.errno).lower() if error.errno else str(error)
