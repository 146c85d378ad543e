"""Serial line between a simulated robot and its client, with injected faults."""

from __future__ import annotations

import random

from observer.simulation.robots.faults import Faults

_PIECE = 7


class Line:
    """Buffer of outgoing bytes, and the noise on both directions.

    Args:
        faults: read at every call. seed: for the noise and the piece sizes.
    """

    def __init__(self, faults: Faults, seed: int = 0) -> None:
        self._faults = faults
        self._random = random.Random(seed)  # nosec B311
        self._held = bytearray()
        self._since: float | None = None

    @property
    def busy(self) -> bool:
        """True while bytes wait to be sent."""
        return bool(self._held)

    def arriving(self, data: bytes) -> bytes:
        """Return what the robot receives of data sent to it."""
        return b"" if self._faults.deaf else self._damaged(data)

    def send(self, data: bytes, now: float) -> None:
        """Queue data for sending to the client."""
        if self._faults.silent or not data:
            return
        if self._since is None:
            self._since = now
        self._held += self._damaged(data)

    def due(self, now: float) -> bytes:
        """Return the bytes to send now."""
        faults = self._faults
        if faults.silent:
            self.clear()
        if self._since is None or now - self._since < faults.merge_s:
            return b""
        size = self._random.randint(1, _PIECE) if faults.split else len(self._held)
        piece = bytes(self._held[:size])
        del self._held[:size]
        if not self._held:
            self._since = None
        return piece

    def clear(self) -> None:
        """Discard the waiting bytes."""
        self._held.clear()
        self._since = None

    def _damaged(self, data: bytes) -> bytes:
        if self._random.random() < self._faults.truncated:
            data = data[: self._random.randrange(len(data))]
        return self.noisy(2 * data if self._faults.repeated else data)

    def noisy(self, data: bytes) -> bytes:
        """Return ``data`` with a share of its bytes corrupted."""
        share = self._faults.noise
        if not share:
            return data
        draw = self._random
        return bytes(
            each ^ draw.randint(1, 255) if draw.random() < share else each for each in data
        )

    def garbage(self, count: int) -> bytes:
        """Return meaningless bytes, as received at a wrong baud rate."""
        return self._random.randbytes(count)
