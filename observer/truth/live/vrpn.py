"""Codec of VRPN, without a socket.

The wire format is that of the public VRPN library, version 07 (``vrpn_Connection.C``,
``vrpn_Tracker.C``, ``vrpn_BaseClass.C``): big-endian; each side starts with a cookie of 24 bytes;
then come messages with a header of 24 bytes (length of header and body without padding, seconds,
microseconds, sender, type, sequence number), bodies padded to 8 bytes. Sender and type numbers are
those that the sending side has described with messages of types -1 and -2.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

COOKIE_LENGTH = 24
COOKIE = b"vrpn: ver. 07.35  0".ljust(COOKIE_LENGTH, b"\0")
# Minor versions are compatible: the library compares up to the last period.
_MAJOR = b"vrpn: ver. 07."
_ANY_VERSION = b"vrpn: ver. "

SENDER_DESCRIPTION, TYPE_DESCRIPTION, UDP_DESCRIPTION = -1, -2, -3
POSE_TYPE = "vrpn_Tracker Pos_Quat"
PING_TYPE, PONG_TYPE = "vrpn_Base ping_message", "vrpn_Base pong_message"
DEFAULT_PORT = 3883

_HEADER = struct.Struct(">iIIiiI")
_POSE = struct.Struct(">ii7d")
_NAME_LENGTH = struct.Struct(">i")
# The library's own buffers: 64,000 bytes, and 100 for a name including its NUL.
_LONGEST_BODY = 64_000
_LONGEST_NAME = 100
_MOST_DESCRIBED = 2000


class VrpnError(Exception):
    """Bytes that are not VRPN; one sentence. What follows them cannot be read either."""


@dataclass(frozen=True)
class Message:
    """Message on the wire.

    Attributes:
        seconds, microseconds: its stamp, each from 0 to 2**32 - 1.
        sender, type: as numbered by the sending side; negative types are the connection's own.
    """

    seconds: int
    microseconds: int
    sender: int
    type: int
    body: bytes


@dataclass(frozen=True)
class TrackerPose:
    """Pose of a body, which is a sensor of a sender.

    Attributes:
        time: the server's stamp, seconds. position: metres, if the server follows the standard.
        quaternion: x, y, z, w, from the body's frame to the room's.
    """

    sender: str
    sensor: int
    time: float
    position: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]


@dataclass(frozen=True)
class Sign:
    """``PING_TYPE``, which asks whether a device is alive, or ``PONG_TYPE``, its answer."""

    type: str
    sender: str


def check_cookie(cookie: bytes) -> str | None:
    """Check that the other side's version is supported.

    Returns:
        None, or a sentence if its minor version is not ours, which works all the same.

    Raises:
        VrpnError: it has another major version, or is not VRPN at all.
    """
    greeting = cookie[:COOKIE_LENGTH].split(b"\0")[0].decode("ascii", "replace").strip()
    if not cookie.startswith(_ANY_VERSION):
        raise VrpnError(f"it is not a VRPN server: it starts with {cookie[:COOKIE_LENGTH]!r}")
    if not cookie.startswith(_MAJOR):
        raise VrpnError(f"it uses another VRPN version ({greeting!r}); 07 is needed")
    if not cookie.startswith(COOKIE[:16]):
        return f"the server uses VRPN {greeting!r}; any 07 version works"
    return None


def pack(message: Message, sequence: int = 0) -> bytes:
    """Encode a message.

    Raises:
        VrpnError: its body is longer than the library accepts.
    """
    if len(message.body) > _LONGEST_BODY:
        raise VrpnError(f"the body of a message may have at most {_LONGEST_BODY} bytes")
    length, stamp = _HEADER.size + len(message.body), (message.seconds, message.microseconds)
    header = _HEADER.pack(length, *stamp, message.sender, message.type, sequence)
    return header + message.body + bytes(-len(message.body) % 8)


def describe(kind: int, number: int, name: str) -> Message:
    """Return the message that announces the name behind a number to the other side.

    Args:
        kind: ``SENDER_DESCRIPTION`` or ``TYPE_DESCRIPTION``.

    Raises:
        VrpnError: the name is longer than the library accepts.
    """
    text = name.encode() + b"\0"
    if _NAME_LENGTH.size + len(text) > _LONGEST_NAME:
        raise VrpnError(f"a name may have at most {_LONGEST_NAME - 5} bytes: {name[:40]!r}")
    return Message(0, 0, number, kind, _NAME_LENGTH.pack(len(text)) + text)


class MessageParser:
    """Parser for messages from chunks of bytes of any size."""

    def __init__(self) -> None:
        self._pending = bytearray()

    def feed(self, data: bytes) -> list[Message]:
        """Return the messages that are complete now.

        Raises:
            VrpnError: a message's length is invalid; messages completed before it are lost, too.
        """
        self._pending += data
        messages: list[Message] = []
        begin = 0
        while len(self._pending) - begin >= _HEADER.size:
            length, seconds, microseconds, sender, type_, _ = _HEADER.unpack_from(
                self._pending, begin
            )
            body = length - _HEADER.size
            if not 0 <= body <= _LONGEST_BODY:
                raise VrpnError(f"a message announces a length of {length} bytes")
            end = begin + _HEADER.size + body + -body % 8
            if end > len(self._pending):
                break
            start = begin + _HEADER.size
            text = bytes(self._pending[start : start + body])
            messages.append(Message(seconds, microseconds, sender, type_, text))
            begin = end
        del self._pending[:begin]
        return messages


class Conversation:
    """Interprets the other side's messages, using the names that it has described."""

    def __init__(self) -> None:
        self._parser = MessageParser()
        self._senders: dict[int, str] = {}
        self._types: dict[int, str] = {}

    @property
    def senders(self) -> tuple[str, ...]:
        """Names of the senders described so far."""
        return tuple(self._senders.values())

    def feed(self, data: bytes) -> list[TrackerPose | Sign]:
        """Return the poses, pings and pongs that are complete with these bytes.

        Raises:
            VrpnError: the bytes are not VRPN.
        """
        meanings = map(self._take, self._parser.feed(data))
        return [meaning for meaning in meanings if meaning is not None]

    def _take(self, message: Message) -> TrackerPose | Sign | None:
        if message.type in (SENDER_DESCRIPTION, TYPE_DESCRIPTION):
            names = self._senders if message.type == SENDER_DESCRIPTION else self._types
            if len(names) >= _MOST_DESCRIBED and message.sender not in names:
                raise VrpnError(f"more than {_MOST_DESCRIBED} names are described")
            names[message.sender] = _name(message.body)
            return None
        # Announcements of a UDP port are not answered, so everything comes over this connection.
        kind = self._types.get(message.type)
        sender = self._senders.get(message.sender)
        if sender is None:
            return None
        if kind == POSE_TYPE:
            if len(message.body) != _POSE.size:
                raise VrpnError(f"a pose must have {_POSE.size} bytes, not {len(message.body)}")
            sensor, _, x, y, z, qx, qy, qz, qw = _POSE.unpack(message.body)
            time = message.seconds + message.microseconds / 1e6
            return TrackerPose(sender, sensor, time, (x, y, z), (qx, qy, qz, qw))
        return Sign(kind, sender) if kind in (PING_TYPE, PONG_TYPE) else None


class Speaker:
    """Encodes our side's messages, describing each name before its first use."""

    def __init__(self) -> None:
        self._senders: dict[str, int] = {}
        self._types: dict[str, int] = {}
        self._sequence = 0

    def say(self, type_: str, sender: str) -> bytes:
        """Encode a message without a body, preceded by the descriptions that it needs.

        Raises:
            VrpnError: a name is longer than the library accepts.
        """
        begin = b""
        for kind, names, name in (
            (SENDER_DESCRIPTION, self._senders, sender),
            (TYPE_DESCRIPTION, self._types, type_),
        ):
            if name not in names:
                begin += self._numbered(describe(kind, len(names), name))
                names[name] = len(names)
        return begin + self._numbered(Message(0, 0, self._senders[sender], self._types[type_], b""))

    def _numbered(self, message: Message) -> bytes:
        data = pack(message, self._sequence)
        self._sequence = (self._sequence + 1) % 2**32
        return data


def _name(body: bytes) -> str:
    if len(body) < _NAME_LENGTH.size:
        raise VrpnError("a description must contain a name")
    (length,) = _NAME_LENGTH.unpack_from(body)
    text = body[_NAME_LENGTH.size :]
    # Some servers count the NUL, some do not.
    if not 0 <= length <= len(text):
        raise VrpnError(f"a name of {length} bytes is announced where {len(text)} follow")
    return text[:length].split(b"\0")[0].decode("utf-8", "replace")
