"""Messages between a camera's process and the source: one line of JSON each.

Every notice fits into a pipe's atomic write (POSIX: at least 512 bytes), so that it is written as
a whole or, where nobody reads, not at all.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import msgspec

from observer.sources.cameras.settings import CameraSettings


class Open(msgspec.Struct, frozen=True, tag=True):
    """Command to open the camera.

    Attributes:
        address: path or URL, password included; it goes through the pipe because anybody on the
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
        rate: frames per second as the camera says, None where it does not.
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
        stamp: exposure, seconds of the host's monotonic clock; arrival where nothing tells it.
        arrival: when it was grabbed, same clock.
        until: when it gives way to the next one, same clock.
    """

    seq: int
    stamp: float
    arrival: float
    until: float


class Ready(msgspec.Struct, frozen=True, tag=True):
    """Notice: the frame lies decoded in the shared memory.

    Attributes:
        repeats: how many images before it were the same to the last bit.
    """

    seq: int
    repeats: int


class Missed(msgspec.Struct, frozen=True, tag=True):
    """Notice: what was to be decoded had already given way to the next frame."""

    seq: int


class Undecodable(msgspec.Struct, frozen=True, tag=True):
    """Notice: what came is no image."""


class Resized(msgspec.Struct, frozen=True, tag=True):
    """Notice: images have another size than at opening; it ends."""

    width: int
    height: int


class Failed(msgspec.Struct, frozen=True, tag=True):
    """Notice: the camera cannot be opened or delivers no more.

    Attributes:
        reason: what follows the camera's name in a sentence.
        alive: True where the process waits for another ``Open``; else it ends.
    """

    reason: str
    alive: bool


Command: TypeAlias = Open | Decode | Drop
Notice: TypeAlias = Opened | Grabbed | Ready | Missed | Undecodable | Resized | Failed

# Decode a line without its end; both sides are of one version.
decode_command: Callable[[bytes], Command] = msgspec.json.Decoder(Command).decode
decode_notice: Callable[[bytes], Notice] = msgspec.json.Decoder(Notice).decode


def encode(message: Command | Notice) -> bytes:
    """Encode a message as a line."""
    return msgspec.json.encode(message) + b"\n"
