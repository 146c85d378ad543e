"""Messages between a camera's process and the source: one line of JSON each.

Every notice fits into a pipe's atomic write (POSIX: at least 512 bytes), so that it is written as
a whole or, if the pipe is full, not at all.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import msgspec

from observer.sources.cameras.settings import CameraSettings


class Open(msgspec.Struct, frozen=True, tag=True):
    """Command to open the camera.

    Attributes:
        address: path or URL, password included; it goes through the pipe because anyone on the
            machine can read a command line.
        opener: ``module:function`` that makes the ``Capture``.
    """

    address: str
    settings: CameraSettings
    opener: str


class Decode(msgspec.Struct, frozen=True, tag=True):
    """Command to decode this frame into the shared memory."""

    seq: int


class Drop(msgspec.Struct, frozen=True, tag=True):
    """Command to drop this frame."""

    seq: int


class Opened(msgspec.Struct, frozen=True, tag=True):
    """Notice: the camera delivers; the shared memory has the size of its images.

    Attributes:
        width, height: of the image as it came, pixels. channels: 1 or 3.
        rate: frames per second as the camera reports them, None where it does not.
        settings, refused: as in ``CameraReport``.
    """

    width: int
    height: int
    channels: int
    rate: float | None
    settings: dict[str, str]
    refused: tuple[str, ...]


class Grabbed(msgspec.Struct, frozen=True, tag=True):
    """Notice: a frame is there, not yet decoded.

    Attributes:
        seq: rises by one with each frame.
        stamp: exposure, seconds of the host's monotonic clock; the arrival where it is unknown.
        arrival: when it was grabbed, same clock.
        received: when it would have been without waiting in the driver's queue, same clock.
        until: when it gives way to the next one, same clock.
    """

    seq: int
    stamp: float
    arrival: float
    received: float
    until: float


class Ready(msgspec.Struct, frozen=True, tag=True):
    """Notice: the decoded frame is in the shared memory.

    Attributes:
        repeats: how many images before it were bit for bit the same.
    """

    seq: int
    repeats: int


class Missed(msgspec.Struct, frozen=True, tag=True):
    """Notice: the frame to be decoded had already given way to the next one."""

    seq: int


class Undecodable(msgspec.Struct, frozen=True, tag=True):
    """Notice: the data received is not an image."""


class Behind(msgspec.Struct, frozen=True, tag=True):
    """Notice: the frame that arrived had waited in a queue for too long and was dropped."""


class Resized(msgspec.Struct, frozen=True, tag=True):
    """Notice: images have another size than at opening; the process ends."""

    width: int
    height: int


class Failed(msgspec.Struct, frozen=True, tag=True):
    """Notice: the camera cannot be opened or no longer delivers.

    Attributes:
        reason: continues a sentence that begins with the camera's name.
        alive: True if the process waits for another ``Open``; else it ends.
    """

    reason: str
    alive: bool


Command: TypeAlias = Open | Decode | Drop
Notice: TypeAlias = Opened | Grabbed | Ready | Missed | Undecodable | Behind | Resized | Failed

# Decode a line without its line end; both sides have the same version.
decode_command: Callable[[bytes], Command] = msgspec.json.Decoder(Command).decode
decode_notice: Callable[[bytes], Notice] = msgspec.json.Decoder(Notice).decode


def encode(message: Command | Notice) -> bytes:
    """Encode a message as a line."""
    return msgspec.json.encode(message) + b"\n"
