"""Packets received from and sent to a port, by one thread."""

from __future__ import annotations

import time
from collections.abc import Callable

from observer.robots.arcos import PacketParser
from observer.robots.serial_port import Port

# The firmware needs 3 to 5 ms between two commands.
COMMAND_GAP_S = 0.004
# A packet is sent without pauses: if nothing follows within this time, the rest was lost.
_QUIET_S = 0.05
_BUFFERED_READS = 16


class Closing(Exception):
    """The owner of the robot is closing it."""


class PacketLine:
    """Packets of a port.

    Args:
        closing: polled during every wait.

    Attributes:
        port, parser: the two parts.

    Raises:
        PortLost: by every method: the port is gone or stuck.
        Closing: by the methods that receive: the owner is closing.
    """

    def __init__(self, port: Port, closing: Callable[[], bool]) -> None:
        self.port = port
        self.parser = PacketParser()
        self._closing = closing

    def receive(self) -> list[bytes]:
        """Return the payloads that have arrived; wait 50 ms at most."""
        if self._closing():
            raise Closing
        data = self.port.read(_QUIET_S)
        if data:
            return self.parser.feed(data)
        return self.parser.abandon() if self.parser.pending else []

    def wait_for(self, wanted: Callable[[bytes], bool], timeout_s: float) -> bytes | None:
        """Return the first wanted payload and drop the others; None if none comes in time."""
        until = time.monotonic() + timeout_s
        while time.monotonic() < until:
            for payload in self.receive():
                if wanted(payload):
                    return payload
        return None

    def drain(self, quiet_s: float, longest_s: float) -> None:
        """Discard everything received until the line is quiet."""
        until = time.monotonic() + longest_s
        while time.monotonic() < until and self.wait_for(lambda _: True, quiet_s) is not None:
            pass
        self.parser.clear()

    def send(self, *commands: bytes) -> None:
        """Write each command separately, with a pause after it."""
        for each in commands:
            self.port.write(each)
            time.sleep(COMMAND_GAP_S)

    def change_baud(self, baud: int) -> None:
        """Change the baud rate once everything written has been transmitted."""
        # There is no reliable sign that a USB adapter has finished; a few commands take 40 ms.
        time.sleep(0.05)
        self.port.change_baud(baud)
        # Buffered data came at the old rate and says nothing about the new one.
        for _ in range(_BUFFERED_READS):
            if not self.port.read(0.0):
                break
        self.parser.clear()
