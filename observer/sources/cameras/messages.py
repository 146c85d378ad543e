"""Messages between a camera's process and the source: one line of JSON each.

Every notice fits into a pipe's atomic write (POSIX: at least 512 bytes), so that it is written as
a whole or, where nobody reads, not at all.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

from observer.sources.cameras.settings import CameraSettings


@dataclass(frozen=True)
class Open:
    """Command to open the camera.

    Attributes:
        address: path or URL, password included; it goes through the pipe because anybody on the
            machine can read a command line.
        settings: the fields of ``CameraSettings``.
        opener: ``module:function`` or ``file.py:function`` that makes the ``Capture``.
    """

    address: str
    settings: Mapping[str, Any]
    opener: str

    def camera_settings(self) -> CameraSettings:
        """Return the settings, with JSON's list made the pair it was."""
        values = dict(self.settings)
        if values.get("size") is not None:
            width, height = values["size"]
            values["size"] = (width, height)
        return CameraSettings(**values)


@dataclass(frozen=True)
class Decode:
    """Command to decode this frame into the shared memory."""

    seq: int


@dataclass(frozen=True)
class Drop:
    """Command to drop this frame."""

    seq: int


@dataclass(frozen=True)
class Opened:
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
    settings: Mapping[str, str]
    refused: tuple[str, ...]


@dataclass(frozen=True)
class Grabbed:
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


@dataclass(frozen=True)
class Ready:
    """Notice: the frame lies decoded in the shared memory.

    Attributes:
        repeats: how many images before it were the same to the last bit.
    """

    seq: int
    repeats: int


@dataclass(frozen=True)
class Missed:
    """Notice: what was to be decoded had already given way to the next frame."""

    seq: int


@dataclass(frozen=True)
class Undecodable:
    """Notice: what came is no image."""


@dataclass(frozen=True)
class Resized:
    """Notice: images have another size than at opening; it ends."""

    width: int
    height: int


@dataclass(frozen=True)
class Failed:
    """Notice: the camera cannot be opened or delivers no more.

    Attributes:
        reason: what follows the camera's name in a sentence.
        alive: True where the process waits for another ``Open``; else it ends.
    """

    reason: str
    alive: bool


Command: TypeAlias = Open | Decode | Drop
Notice: TypeAlias = Opened | Grabbed | Ready | Missed | Undecodable | Resized | Failed
_COMMANDS: Mapping[str, type[Command]] = {each.__name__: each for each in (Open, Decode, Drop)}
_NOTICES: Mapping[str, type[Notice]] = {
    each.__name__: each for each in (Opened, Grabbed, Ready, Missed, Undecodable, Resized, Failed)
}


def encode(message: Command | Notice) -> bytes:
    """Encode a message as a line."""
    return json.dumps([type(message).__name__, vars(message)]).encode() + b"\n"


def decode_command(line: bytes) -> Command:
    """Decode the command in a line without its end; both sides are of one version."""
    kind, values = json.loads(line)
    return _COMMANDS[kind](**values)


def decode_notice(line: bytes) -> Notice:
    """Decode the notice in a line without its end; both sides are of one version."""
    kind, values = json.loads(line)
    if kind == Opened.__name__:
        values["refused"] = tuple(values["refused"])
    return _NOTICES[kind](**values)
