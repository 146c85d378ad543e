"""The port of an ARCOS robot, serial or TCP, through pyserial.

It makes up for the gaps in pyserial's ``socket://``: Nagle's algorithm is switched off, reading
waits on the socket itself (``in_waiting`` is no byte count there), and closing closes the socket.
"""

from __future__ import annotations

import errno
import os
import select
import socket
import stat
import struct
import termios
from typing import Any, Protocol

FIRST_BAUD = 9600
# A port that accepts no data for this long is stuck.
WRITE_TIMEOUT_S = 0.2
_LONGEST_READ = 4096
# Time for the other side to read the last commands before the connection is closed.
_LAST_WORDS_S = 0.1
# Kinds of files that are not character devices.
_KINDS = {
    stat.S_IFREG: "a file",
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a local socket",
    stat.S_IFBLK: "a disk",
}
# pyserial raises its own OSError, lets termios errors through, and fails on files that
# another thread has closed.
_FAILURES = (OSError, ValueError, TypeError, termios.error)


class PortLost(Exception):
    """The port cannot be opened, is gone, or accepts no data. The message is a sentence."""


class Port(Protocol):
    """Bytes in and out. One thread reads, one writes."""

    @property
    def name(self) -> str:
        """Name of the port, for people."""
        ...

    @property
    def serial_line(self) -> bool:
        """Return whether it has a baud rate."""
        ...

    @property
    def baud(self) -> int | None:
        """Baud rate; None without one."""
        ...

    def read(self, timeout_s: float) -> bytes:
        """Return the received bytes, waiting at most ``timeout_s``; empty if there are none.

        Raises:
            PortLost: it is gone.
        """
        ...

    def write(self, data: bytes) -> None:
        """Write all of it; takes ``WRITE_TIMEOUT_S`` at most.

        Raises:
            PortLost: it is gone or stuck.
        """
        ...

    def change_baud(self, baud: int) -> None:
        """Change the baud rate; do nothing where there is none.

        Raises:
            PortLost: it is gone or does not support the rate.
        """
        ...

    def close(self, *, discard: bool) -> None:
        """Release it; safe to call twice. ``discard``: drop unsent data."""
        ...


def open_port(text: str) -> Port:
    """Open ``/dev/...`` at ``FIRST_BAUD`` 8N1, or ``socket://HOST:PORT``.

    It waits at most 5 s for a host that does not answer.

    Raises:
        PortLost: it cannot be opened; the message says why.
    """
    # Imported here: only drivers of such robots need it.
    import serial  # type: ignore[import-untyped]

    tcp = text.lower().startswith("socket://")
    settings: dict[str, Any] = {"baudrate": FIRST_BAUD, "timeout": 0}
    settings["write_timeout"] = WRITE_TIMEOUT_S
    if not tcp:
        settings["exclusive"] = True
    try:
        if not tcp:
            _refuse_other_files(text)
        return _PySerialPort(text, serial.serial_for_url(text, **settings), tcp)
    except _FAILURES as error:
        raise PortLost(f"{text} cannot be opened: {_reason(error)}") from error


def _refuse_other_files(path: str) -> None:
    """Refuse anything but a serial device, without opening it.

    Opening is not harmless: pyserial locks what it opens, opening a named pipe wakes the process at
    its other end, and opening the machine's watchdog device starts it.

    Raises:
        PortLost: it is something else. OSError: it does not exist, or may not be examined.
    """
    status = os.stat(path)
    kind = _KINDS.get(stat.S_IFMT(status.st_mode))
    if kind is None:
        device = f"{os.major(status.st_rdev)}:{os.minor(status.st_rdev)}"
        # Linux has no entry for pseudo-terminals here; other systems lack the folder.
        subsystem = os.path.realpath(f"/sys/dev/char/{device}/subsystem")
        if os.path.exists(subsystem) and os.path.basename(subsystem) != "tty":
            kind = "another kind of device"
    if kind is not None:
        raise PortLost(f"{path} cannot be opened: it is {kind}, not a serial port")


class _PySerialPort:
    def __init__(self, name: str, device: Any, tcp: bool) -> None:
        self.name = name
        self._device = device
        # pyserial does not expose the socket, but its options have to be set.
        self._socket: socket.socket | None = getattr(device, "_socket", None) if tcp else None
        self._closed = False
        if self._socket is not None:
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    @property
    def serial_line(self) -> bool:
        return self._socket is None

    @property
    def baud(self) -> int | None:
        return int(self._device.baudrate) if self.serial_line else None

    def read(self, timeout_s: float) -> bytes:
        try:
            ready, _, _ = select.select([self._device.fileno()], [], [], timeout_s)
            return bytes(self._device.read(_LONGEST_READ)) if ready else b""
        except _FAILURES as error:
            raise PortLost(f"the connection to {self.name} was lost: {_reason(error)}") from error

    def write(self, data: bytes) -> None:
        import serial

        try:
            self._device.write(data)
        except serial.SerialTimeoutException as error:
            raise PortLost(f"{self.name} no longer accepts data") from error
        except _FAILURES as error:
            raise PortLost(f"the connection to {self.name} was lost: {_reason(error)}") from error

    def change_baud(self, baud: int) -> None:
        if not self.serial_line:
            return
        try:
            self._device.baudrate = baud
        except _FAILURES as error:
            raise PortLost(f"{self.name} cannot be set to {baud} baud: {_reason(error)}") from error

    def close(self, *, discard: bool) -> None:
        if self._closed:
            return
        self._closed = True
        if self._socket is None:
            self._close_serial(discard)
        else:
            _close_socket(self._socket, discard)
            # pyserial's own close waits 0.3 s and may leave the socket open.
            self._device.is_open = False

    def _close_serial(self, discard: bool) -> None:
        try:
            if discard:
                self._device.reset_output_buffer()
        except _FAILURES:
            # It is gone, and unsent data with it.
            return
        finally:
            self._device.close()


def _close_socket(connection: socket.socket, discard: bool) -> None:
    try:
        if discard:
            # Reset without lingering: buffered velocities must not arrive later.
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        else:
            # Closing with unread data would reset the connection, and the last commands
            # might be lost.
            connection.shutdown(socket.SHUT_WR)
            connection.settimeout(_LAST_WORDS_S)
            for _ in range(_LONGEST_READ):
                if not connection.recv(_LONGEST_READ):
                    break
    except OSError:
        # The other side is already gone.
        return
    finally:
        connection.close()


def _reason(error: BaseException) -> str:
    """Return the system's own message, which pyserial wraps once or twice."""
    cause: BaseException | None = error
    while cause is not None:
        args = cause.args
        if len(args) > 1 and isinstance(args[0], int):
            return _words(args[0], str(args[1]))
        cause = cause.__context__
    return str(error)


def _words(number: int, text: str) -> str:
    if number == errno.EACCES:
        return "this user has no permission to open it; members of the group dialout usually do"
    if number in (errno.EAGAIN, errno.EWOULDBLOCK):
        return "it is in use by another program"
    if number == errno.ENOTTY:
        return "it is not a serial port"
    if number == errno.ENOENT:
        return "there is no such device; is it plugged in?"
    return text.split("] ")[-1].lower()
