"""The packets of ARCOS and AmigOS robots: bytes to payloads and back. Pure.

A packet is ``FA FB count data checksum`` with ``count`` the length of data and checksum. Numbers
in data are little-endian, the checksum is big-endian: the sum of data's big-endian 16-bit words
modulo 2^16, with an odd last byte XORed into the low byte (Pioneer 3 operations manual, "ARCOS").
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum

HEADER = b"\xfa\xfb"
# The count is one byte and includes the checksum.
LONGEST_PAYLOAD = 255 - 2
_SHORTEST_COUNT = 3

_POSITIVE, _NEGATIVE, _TEXT = 0x3B, 0x1B, 0x2B


class Command(IntEnum):
    """Commands to a robot. RESET and MAINTENANCE are left out: they are never sent."""

    PULSE = 0
    OPEN = 1
    CLOSE = 2
    ENABLE = 4
    SETA = 5
    SETV = 6
    SETO = 7
    MOVE = 8
    SETRV = 10
    VEL = 11
    HEAD = 12
    DHEAD = 13
    CONFIG = 18
    ENCODER = 19
    RVEL = 21
    SETRA = 23
    SONAR = 28
    STOP = 29
    VEL2 = 32
    IOREQUEST = 40
    BUMPSTALL = 44
    HOSTBAUD = 50
    E_STOP = 55
    BATTEST = 250


def checksum(data: bytes) -> int:
    """Return the checksum of a packet's data, 0 to 0xFFFF; see the module."""
    even = len(data) & ~1
    total: int = sum(struct.unpack(f">{even // 2}H", data[:even])) & 0xFFFF
    return total ^ data[-1] if len(data) > even else total


def packet(data: bytes) -> bytes:
    """Frame a payload.

    Raises:
        ValueError: it is empty or longer than ``LONGEST_PAYLOAD``.
    """
    if not 1 <= len(data) <= LONGEST_PAYLOAD:
        raise ValueError(f"a packet must carry 1 to {LONGEST_PAYLOAD} bytes, not {len(data)}")
    return HEADER + bytes([len(data) + 2]) + data + checksum(data).to_bytes(2, "big")


def command(number: int, argument: int | bytes | None = None) -> bytes:
    """Encode one command as a packet.

    Args:
        number: of ``Command``, 0 to 255. argument: None, a number from -32768 to 65535, or text of
            at most 200 bytes.

    Raises:
        ValueError: the number or the argument does not fit.
    """
    if not 0 <= number <= 255:
        raise ValueError(f"a command number must be 0 to 255, not {number}")
    if argument is None:
        return packet(bytes([number]))
    if isinstance(argument, bytes):
        if len(argument) > 200:
            raise ValueError(
                f"the text of a command may have at most 200 bytes, not {len(argument)}"
            )
        return packet(bytes([number, _TEXT, len(argument)]) + argument)
    if not -32768 <= argument <= 65535:
        raise ValueError(f"the argument of a command must be -32768 to 65535, not {argument}")
    kind = _POSITIVE if argument >= 0 else _NEGATIVE
    return packet(struct.pack("<BBH", number, kind, abs(argument)))


@dataclass(frozen=True)
class Decoded:
    """A command as a robot reads it.

    Attributes:
        number: of ``Command``. argument: None, a signed number or text.
    """

    number: int
    argument: int | bytes | None = None


def decode_command(payload: bytes) -> Decoded:
    """Decode the command in a payload.

    Raises:
        ValueError: it is empty, or its argument is cut off or of an unknown type.
    """
    if not payload:
        raise ValueError("a command has at least one byte")
    if len(payload) == 1:
        return Decoded(payload[0])
    kind, rest = payload[1], payload[2:]
    if kind in (_POSITIVE, _NEGATIVE) and len(rest) >= 2:
        magnitude = int.from_bytes(rest[:2], "little")
        return Decoded(payload[0], magnitude if kind == _POSITIVE else -magnitude)
    if kind == _TEXT and rest and len(rest) > rest[0]:
        return Decoded(payload[0], bytes(rest[1 : 1 + rest[0]]))
    raise ValueError(f"command {payload[0]} has an argument that cannot be read: {payload.hex()}")


class PacketParser:
    """Finds the packets in a stream that may be damaged anywhere.

    After any failure the search resumes at the byte after the start of the failed header, so that
    a damaged packet never swallows an intact one after it.

    Attributes:
        packets, bad_packets: packets with a correct checksum, and headers without such a packet.
        skipped_bytes: that belonged to no packet.
    """

    def __init__(self) -> None:
        self.packets = 0
        self.bad_packets = 0
        self.skipped_bytes = 0
        self._rest = bytearray()

    @property
    def pending(self) -> bool:
        """Return whether an incomplete packet is buffered."""
        return bool(self._rest)

    def feed(self, data: bytes) -> list[bytes]:
        """Return the payloads that these bytes complete, in order."""
        self._rest += data
        return self._scan()

    def abandon(self) -> list[bytes]:
        """Give up the incomplete packet; return the complete ones after its header.

        A damaged count may announce more bytes than will ever come. Call this when nothing more
        has arrived for a while.
        """
        found: list[bytes] = []
        while self._rest:
            # A truncated header does not count as a bad packet.
            if len(self._rest) > 2:
                self.bad_packets += 1
            self._skip(1)
            found += self._scan()
        return found

    def clear(self) -> None:
        """Discard the incomplete packet."""
        self.skipped_bytes += len(self._rest)
        self._rest.clear()

    def _scan(self) -> list[bytes]:
        found: list[bytes] = []
        rest = self._rest
        while True:
            self._skip_to_header()
            if len(rest) < 3:
                return found
            count = rest[2]
            if len(rest) < 3 + count and count >= _SHORTEST_COUNT:
                return found
            data, check = bytes(rest[3 : 1 + count]), rest[1 + count : 3 + count]
            if count < _SHORTEST_COUNT or checksum(data) != int.from_bytes(check, "big"):
                self.bad_packets += 1
                self._skip(1)
                continue
            self.packets += 1
            del rest[: 3 + count]
            found.append(data)

    def _skip_to_header(self) -> None:
        at = self._rest.find(HEADER)
        # The last byte may be the first of a header.
        self._skip(at if at >= 0 else len(self._rest) - self._rest.endswith(HEADER[:1]))

    def _skip(self, count: int) -> None:
        self.skipped_bytes += count
        del self._rest[:count]
