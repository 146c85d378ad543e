"""Serves a simulated robot on a TCP port of loopback or a pseudo terminal.

    with serve_tcp(EmulatedRobot("p3dx-sh", now=time.monotonic())) as serving:
        serving.port                    # socket://127.0.0.1:41234, for open_robot
        serving.robot.faults.noise = 0.01
        serving.robot.log.since(moment) # every command with its time of arrival

Each served robot has one thread, which waits for bytes and ticks the robot every 10 ms.
"""

from __future__ import annotations

import os
import select
import socket
import termios
import threading
import time
import tty
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Generic, Protocol, Self, TypeVar

from observer.errors import InputError
from observer.simulation.robots.faults import Faults
from observer.simulation.robots.firmware import Firmware
from observer.simulation.robots.line import Line

TICK_S = 0.01
# Seconds between two pieces of split output.
_PIECE_S = 0.002
_CHUNK = 4096
_RATES = {rate: getattr(termios, f"B{rate}") for rate in (9600, 19200, 38400, 57600, 115200)}


class _Door(Protocol):
    """Transport of the bytes; used by the serving thread only."""

    @property
    def port(self) -> str: ...

    def waiting_for(self) -> list[int]:
        """Return the file descriptors to select for reading."""
        ...

    def take(self, ready: list[int]) -> tuple[bytes, bool]:
        """Return the bytes received, and True if the client disconnected."""
        ...

    def write(self, data: bytes) -> None:
        """Write to the client, if there is one; what does not fit is lost."""
        ...

    def tend(self, welcome: bool) -> bool:
        """Start or stop accepting clients; return True if that disconnected one."""
        ...

    @property
    def has_client(self) -> bool: ...

    def close(self) -> None: ...


R = TypeVar("R", bound=Firmware)


class Serving(Generic[R]):
    """A robot that is served from construction until ``close``.

    Args:
        robot: ticked only by the serving thread. clock: monotonic seconds.

    Attributes:
        robot: with its ``faults`` and its ``log``. port: in the form ``open_robot`` takes.
    """

    def __init__(
        self, robot: R, door: _Door, *, clock: Callable[[], float] = time.monotonic, seed: int = 0
    ) -> None:
        self.robot = robot
        self.port = door.port
        self._door = door
        self._clock = clock
        self._line = Line(robot.faults, seed)
        self._ending = False
        self._wake_read, self._wake_write = os.pipe()
        os.set_blocking(self._wake_write, False)
        self._thread = threading.Thread(target=self._run, name=f"robot {door.port}", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def connected(self) -> bool:
        """True while a client is connected; always on a pseudo terminal that is plugged in."""
        return self._door.has_client

    def close(self) -> None:
        """Stop serving; safe to call twice."""
        if self._ending:
            return
        self._ending = True
        with suppress(OSError):
            os.write(self._wake_write, b"x")
        self._thread.join(5)
        os.close(self._wake_read)
        os.close(self._wake_write)

    def _run(self) -> None:
        try:
            while not self._ending:
                self._turn()
        finally:
            self._door.close()

    def _turn(self) -> None:
        robot, door, line = self.robot, self._door, self._line
        if door.tend(not robot.faults.unplugged):
            self._gone()
        wait = _PIECE_S if line.busy else TICK_S
        ready = select.select([self._wake_read, *door.waiting_for()], [], [], wait)[0]
        if self._wake_read in ready:
            os.read(self._wake_read, _CHUNK)
        data, went = door.take(ready)
        now = self._clock()
        if data:
            line.send(robot.receive(line.arriving(data), now), now)
        if went:
            self._gone()
        line.send(robot.tick(now), now)
        if not door.has_client:
            line.clear()
        piece = line.due(now)
        if piece:
            door.write(piece)

    def _gone(self) -> None:
        self.robot.cut_off()
        self._line.clear()


class _TcpDoor:
    """TCP port for one client at a time; meanwhile others are refused."""

    def __init__(self, port: int) -> None:
        self._listener: socket.socket | None = None
        self._client: socket.socket | None = None
        try:
            self._listener = socket.create_server(("127.0.0.1", port))
        except OSError as error:
            raise InputError(f"port {port} on this machine cannot be used: {error}") from None
        self._address = self._listener.getsockname()
        self._listener.setblocking(False)

    @property
    def port(self) -> str:
        return f"socket://{self._address[0]}:{self._address[1]}"

    @property
    def has_client(self) -> bool:
        return self._client is not None

    def waiting_for(self) -> list[int]:
        return [each.fileno() for each in (self._listener, self._client) if each is not None]

    def take(self, ready: list[int]) -> tuple[bytes, bool]:
        if self._listener is not None and self._listener.fileno() in ready:
            with suppress(OSError):
                self._client = self._listener.accept()[0]
                self._client.setblocking(False)
                self._client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._close_listener()
            return b"", False
        if self._client is None or self._client.fileno() not in ready:
            return b"", False
        try:
            data = self._client.recv(_CHUNK)
        except BlockingIOError:
            return b"", False
        except OSError:
            data = b""
        if not data:
            self._send_away()
        return data, not data

    def write(self, data: bytes) -> None:
        if self._client is not None:
            with suppress(OSError):
                self._client.send(data)

    def tend(self, welcome: bool) -> bool:
        had = self._client is not None
        if not welcome:
            self._send_away()
            self._close_listener()
        elif self._client is None and self._listener is None:
            # Another process may have taken the port; retry at the next tick.
            with suppress(OSError):
                self._listener = socket.create_server(self._address)
                self._listener.setblocking(False)
        return had and self._client is None

    def close(self) -> None:
        self._send_away()
        self._close_listener()

    def _send_away(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None

    def _close_listener(self) -> None:
        if self._listener is not None:
            self._listener.close()
            self._listener = None


class _PtyDoor:
    """Pseudo terminal whose name, if linked, survives unplugging."""

    def __init__(self, link: Path | None, baud: Callable[[], int] | None) -> None:
        self._link = link
        self._baud = baud
        self._master = self._slave = -1
        self._garbage = Line(Faults(), 1)
        self._plug()

    @property
    def port(self) -> str:
        return os.ttyname(self._slave) if self._link is None else str(self._link)

    @property
    def has_client(self) -> bool:
        return self._master >= 0

    def waiting_for(self) -> list[int]:
        return [self._master] if self._master >= 0 else []

    def take(self, ready: list[int]) -> tuple[bytes, bool]:
        if self._master not in ready:
            return b"", False
        try:
            data = os.read(self._master, _CHUNK)
        except OSError:
            return b"", False
        return (data if self._understood() else self._garbage.garbage(len(data))), False

    def write(self, data: bytes) -> None:
        # Without a reader the bytes are lost, as on a serial line.
        with suppress(BlockingIOError):
            os.write(self._master, data if self._understood() else self._garbage.garbage(len(data)))

    def tend(self, welcome: bool) -> bool:
        if welcome and self._master < 0:
            self._plug()
        elif not welcome and self._master >= 0:
            self.close()
            return True
        return False

    def close(self) -> None:
        if self._master < 0:
            return
        if self._link is not None:
            self._link.unlink(missing_ok=True)
        os.close(self._master)
        os.close(self._slave)
        self._master = self._slave = -1

    def _plug(self) -> None:
        self._master, self._slave = os.openpty()
        # Otherwise the terminal echoes and edits bytes until the client configures it.
        tty.setraw(self._slave)
        settings = termios.tcgetattr(self._slave)
        settings[4] = settings[5] = _RATES[9600]
        termios.tcsetattr(self._slave, termios.TCSANOW, settings)
        os.set_blocking(self._master, False)
        if self._link is not None:
            self._link.unlink(missing_ok=True)
            self._link.symlink_to(os.ttyname(self._slave))

    def _understood(self) -> bool:
        """True if both ends are set to the same baud rate."""
        if self._baud is None:
            return True
        return bool(termios.tcgetattr(self._slave)[5] == _RATES.get(self._baud()))


def serve_tcp(
    robot: R, port: int = 0, *, clock: Callable[[], float] = time.monotonic, seed: int = 0
) -> Serving[R]:
    """Serve on a TCP port of 127.0.0.1; 0 picks a free one. A second client is refused.

    A session that its client did not CLOSE stays open for the next client, as with a serial
    adapter.

    Raises:
        InputError: the port cannot be used.
    """
    return Serving(robot, _TcpDoor(port), clock=clock, seed=seed)


def serve_pty(
    robot: R,
    link: Path | None = None,
    *,
    rates: bool = False,
    clock: Callable[[], float] = time.monotonic,
    seed: int = 0,
) -> Serving[R]:
    """Serve on a pseudo terminal.

    Args:
        link: a symbolic link to it, absent while it is unplugged, like udev's; without one the
            name changes whenever it is plugged in, and ``Serving.port`` is the first name.
        rates: the client must use the firmware's baud rate (9600 until HOSTBAUD), and receives
            garbage otherwise.
    """
    baud = (lambda: robot.baud) if rates else None
    return Serving(robot, _PtyDoor(link, baud), clock=clock, seed=seed)
