"""Listening side of a network robot: one thread, any number of connections, one robot."""

from __future__ import annotations

import contextlib
import hmac
import selectors
import socket
import threading
from collections.abc import Callable
from dataclasses import dataclass, field

from observer.robots.contract import RobotPhase
from observer.robots.network.messages import (
    BadMessage,
    Lines,
    Permit,
    parse_hello,
    parse_odometry,
    permit_line,
    refusal_line,
    welcome_line,
)
from observer.robots.network.watch import ExternalWatch

PERMIT_INTERVAL_S = 0.05
EXPIRES_S = 0.25
_HELLO_WITHIN_S = 2.0
_RETRY_S = 1.0
# After a failed accept, often for want of descriptors, the connection still waits and would wake
# the thread again at once.
_ACCEPT_AGAIN_S = 0.5
# Most connections that have not sent their hello yet.
_MOST_STRANGERS = 4
# Far above any robot's rate; a flood of messages would delay the permits.
_MOST_LINES_PER_S = 1000
_CHUNK = 16 * 1024
# Small, because a permit that the robot reads late is of no use to it.
_SEND_BUFFER = 4096


@dataclass(frozen=True)
class ExternalPort:
    """Address to listen at, and the key that a robot must send; None if no key is needed."""

    host: str
    port: int
    key: str | None


@dataclass(eq=False)
class _Connection:
    """One accepted connection."""

    socket: socket.socket
    since: float
    lines: Lines = field(default_factory=Lines)
    unsent: bytes = b""
    counted_since: float = 0.0
    count: int = 0


class ExternalLink:
    """Listens, and sends permits every 50 ms and immediately on a change.

    Args:
        port: where to listen.
        watch, lock: the state of the robot and its permits, and the lock that guards it.
        clock: the host's monotonic clock.
    """

    def __init__(
        self,
        port: ExternalPort,
        watch: ExternalWatch,
        lock: threading.Lock,
        clock: Callable[[], float],
    ) -> None:
        self._host, self._port, self._key = port.host, port.port, port.key
        self._watch, self._lock, self._clock = watch, lock, clock
        self._closing = threading.Event()
        self._strangers: list[_Connection] = []
        # When to accept connections again after one could not be accepted.
        self._accept_again: float | None = None
        self._robot: _Connection | None = None
        self._sequence = 0
        self._permit: Permit | None = None
        self._permit_due = 0.0
        self._selector = selectors.DefaultSelector()
        self._woken, self._waker = socket.socketpair()
        for each in (self._woken, self._waker):
            each.setblocking(False)
        self._selector.register(self._woken, selectors.EVENT_READ)
        self._thread = threading.Thread(target=self._run, name=f"external {port.port}", daemon=True)
        self._thread.start()

    def wake(self) -> None:
        """Have a changed permit sent immediately. Never blocks."""
        # A full pipe wakes the thread as well; with a closed one there is no thread to wake.
        with contextlib.suppress(OSError):
            self._waker.send(b"!")

    def close(self, within_s: float) -> None:
        """Send a last permit, close all connections, stop listening."""
        self._closing.set()
        self.wake()
        self._thread.join(within_s)

    # --- the thread ---------------------------------------------------------------------------

    def _run(self) -> None:
        try:
            while not self._closing.is_set():
                listener = self._listen()
                if listener is None:
                    self._closing.wait(_RETRY_S)
                    continue
                with listener:
                    self._serve(listener)
        finally:
            if not self._closing.is_set():
                # After an unexpected error it must not appear to be waiting.
                with self._lock:
                    self._watch.failed()
            self._selector.close()
            self._woken.close()
            self._waker.close()

    def _listen(self) -> socket.socket | None:
        try:
            listener = socket.create_server(
                (self._host, self._port),
                family=socket.AF_INET6 if ":" in self._host else socket.AF_INET,
                backlog=_MOST_STRANGERS,
            )
        except OSError as error:
            why = error.strerror or str(error)
            with self._lock:
                self._watch.lost(f"cannot listen on {self._host}:{self._port}: {why}")
            return None
        listener.setblocking(False)
        with self._lock:
            self._watch.lost(f"no robot has connected to {self._host}:{self._port}")
        return listener

    def _serve(self, listener: socket.socket) -> None:
        self._selector.register(listener, selectors.EVENT_READ)
        try:
            while not self._closing.is_set():
                if self._accept_again is not None and self._clock() >= self._accept_again:
                    self._accept_again = None
                    self._selector.register(listener, selectors.EVENT_READ)
                for key, _ in self._selector.select(self._patience()):
                    if key.fileobj is listener:
                        self._accept(listener)
                    elif key.fileobj is self._woken:
                        with contextlib.suppress(BlockingIOError):
                            self._woken.recv(4096)
                    else:
                        self._read(key.data)
                self._dismiss_silent_strangers()
                self._say_permit()
        finally:
            if self._accept_again is None:
                self._selector.unregister(listener)
            if self._robot is not None:
                self._say_permit()
            # Sending the permit may have shown that the robot is gone.
            if self._robot is not None:
                self._drop(self._robot, None, "its port is closed")
            for each in tuple(self._strangers):
                self._drop(each, None)

    def _patience(self) -> float:
        if self._robot is not None:
            return max(0.0, self._permit_due - self._clock())
        if self._strangers:
            return PERMIT_INTERVAL_S
        return _RETRY_S if self._accept_again is None else _ACCEPT_AGAIN_S

    def _accept(self, listener: socket.socket) -> None:
        try:
            accepted, _ = listener.accept()
        except (BlockingIOError, ConnectionAbortedError):
            # The peer has disconnected again.
            return
        except OSError:
            self._selector.unregister(listener)
            self._accept_again = self._clock() + _ACCEPT_AGAIN_S
            return
        accepted.setblocking(False)
        accepted.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        accepted.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        connection = _Connection(accepted, self._clock())
        if len(self._strangers) >= _MOST_STRANGERS:
            self._send(connection, refusal_line("too many simultaneous connections; try again"))
            accepted.close()
            return
        self._strangers.append(connection)
        self._selector.register(accepted, selectors.EVENT_READ, connection)

    def _read(self, connection: _Connection) -> None:
        try:
            data = connection.socket.recv(_CHUNK)
        except BlockingIOError:
            return
        except OSError as error:
            self._drop(connection, None, _lost(error))
            return
        if not data:
            self._drop(connection, None, "the robot closed the connection")
            return
        try:
            for line in connection.lines.feed(data):
                self._take_in(connection, line)
        except BadMessage as error:
            with self._lock:
                if connection is self._robot:
                    self._watch.bad()
                else:
                    self._watch.refused(str(error))
            self._drop(connection, str(error), f"the robot sent an invalid message: {error}")

    def _take_in(self, connection: _Connection, line: bytes) -> None:
        now = self._clock()
        if now - connection.counted_since > 1:
            connection.counted_since, connection.count = now, 0
        connection.count += 1
        if connection.count > _MOST_LINES_PER_S:
            raise BadMessage(f"at most {_MOST_LINES_PER_S} messages per second are accepted")
        if connection is self._robot:
            message = parse_odometry(line)
            with self._lock:
                self._watch.said(message, now)
        elif connection in self._strangers:
            self._welcome(connection, line, now)

    def _welcome(self, connection: _Connection, line: bytes, now: float) -> None:
        hello = parse_hello(line)
        if self._key is not None and not hmac.compare_digest(
            (hello.key or "").encode("utf-8", "replace"), self._key.encode()
        ):
            raise BadMessage("hello: wrong key")
        before = self._robot
        if before is not None:
            with self._lock:
                silent = self._watch.silent(now)
            if not silent:
                raise BadMessage("another robot is already connected here")
            self._drop(
                before, "another robot replaced it", "the robot stopped responding and reconnected"
            )
        self._strangers.remove(connection)
        self._robot = connection
        self._permit, self._permit_due = None, now
        with self._lock:
            self._watch.connected(hello, now)
        self._send(connection, welcome_line(PERMIT_INTERVAL_S, EXPIRES_S))

    def _dismiss_silent_strangers(self) -> None:
        now = self._clock()
        for each in tuple(self._strangers):
            if now - each.since > _HELLO_WITHIN_S:
                self._drop(each, f"send hello within {_HELLO_WITHIN_S:g} s")

    def _say_permit(self) -> None:
        robot = self._robot
        if robot is None:
            return
        now = self._clock()
        with self._lock:
            permit = self._watch.permit(now)
            if permit == self._permit and now < self._permit_due:
                return
            self._sequence += 1
            sequence = self._sequence
        # An unsent permit is dropped for a newer one, unless part of its line is already out.
        if not self._send(robot, permit_line(permit, sequence, now, EXPIRES_S)):
            self._permit_due = now + PERMIT_INTERVAL_S
            return
        self._permit, self._permit_due = permit, now + PERMIT_INTERVAL_S
        with self._lock:
            if self._watch.phase is RobotPhase.CONNECTED:
                self._watch.permit_sent(permit, sequence, now)

    def _send(self, connection: _Connection, line: bytes) -> bool:
        """Send a line; return whether at least its beginning went out. Never blocks."""
        try:
            if connection.unsent:
                sent = connection.socket.send(connection.unsent)
                connection.unsent = connection.unsent[sent:]
            if connection.unsent:
                return False
            sent = connection.socket.send(line)
            connection.unsent = line[sent:]
        except BlockingIOError:
            return False
        except OSError as error:
            self._drop(connection, None, _lost(error))
            return False
        return True

    def _drop(self, connection: _Connection, refusal: str | None, sentence: str = "") -> None:
        """Close a connection.

        Args:
            refusal: reason sent to the peer, None for none. sentence: why the robot was lost.
        """
        if connection not in self._strangers and connection is not self._robot:
            return
        self._selector.unregister(connection.socket)
        if connection is self._robot:
            self._robot = None
            with self._lock:
                self._watch.lost(sentence or "the connection to the robot was lost")
        else:
            self._strangers.remove(connection)
        if refusal is not None and not connection.unsent:
            self._send(connection, refusal_line(refusal))
        connection.socket.close()


def _lost(error: OSError) -> str:
    return f"the connection to the robot was lost ({error.strerror or error})"
