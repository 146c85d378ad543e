"""Settings of a camera, as written after the ``?`` of its spec."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias
from urllib.parse import parse_qsl

from observer.camera import MAX_IMAGE_PX
from observer.errors import SourceError

Auto: TypeAlias = Literal["auto"]

# Smallest image in each direction.
_LEAST_PX = 16


@dataclass(frozen=True)
class CameraSettings:
    """Settings asked of a camera; None leaves a value as the camera has it.

    Attributes:
        size: width and height of the image the camera delivers, pixels; for a side-by-side
            camera of both images together.
        rate: frames per second.
        pixel_format: the four characters of V4L2's pixel format, as in ``MJPG`` or ``YUYV``.
        exposure: in the camera's own unit (UVC: 100 us), which turns automatic exposure off;
            ``auto`` turns it on.
        gain: in the camera's own unit, or ``auto``.
        white_balance: colour temperature, kelvin, or ``auto``.
        focus: in the camera's own unit, or ``auto``.
        power_line_hz: 50 or 60, 0 for no flicker compensation, or ``auto``.
    """

    size: tuple[int, int] | None = None
    rate: float | None = None
    pixel_format: str | None = None
    exposure: int | Auto | None = None
    gain: int | Auto | None = None
    white_balance: int | Auto | None = None
    focus: int | Auto | None = None
    power_line_hz: Literal[0, 50, 60] | Auto | None = None


@dataclass(frozen=True)
class AppliedSettings:
    """Settings as a camera took them.

    Attributes:
        accepted: what it now has, in words by name, as in ``{"exposure": "156 (locked)"}``.
        refused: one sentence for each setting that was asked for and not accepted.
    """

    accepted: Mapping[str, str] = field(default_factory=dict)
    refused: tuple[str, ...] = ()


def parse_settings(query: str) -> CameraSettings:
    """Read ``size=640x480&rate=30&format=MJPG&exposure=156&white_balance=auto``.

    Keys: ``size``, ``rate``, ``format``, ``exposure``, ``gain``, ``white_balance``, ``focus``,
    ``power_line``.

    Raises:
        SourceError: a key is unknown or given twice, or its value is invalid; the sentence names
            the key and what would be right.
    """
    values: dict[str, object] = {}
    for key, value in parse_qsl(query, keep_blank_values=True):
        reader = _READERS.get(key)
        if reader is None:
            raise SourceError(
                f"there is no camera setting {key[:40]!r}; the settings are {', '.join(_READERS)}"
            )
        attribute, read = reader
        if attribute in values:
            raise SourceError(f"the camera setting {key} is given twice; give it once")
        text = value.strip()
        try:
            values[attribute] = read(text)
        except ValueError as right:
            raise SourceError(
                f"the camera setting {key}={text:.40} is not valid; use {right}"
            ) from None
    return CameraSettings(**values)  # type: ignore[arg-type]


# Readers of a value; a ValueError says what would be right.


def _read_size(text: str) -> tuple[int, int]:
    width, _, height = text.lower().partition("x")
    if not (_is_number(width) and _is_number(height)):
        raise ValueError("WIDTHxHEIGHT in pixels, for example 640x480")
    size = (int(width), int(height))
    if not all(_LEAST_PX <= length <= MAX_IMAGE_PX for length in size):
        raise ValueError(
            f"{_LEAST_PX} to {MAX_IMAGE_PX} pixels in each direction, for example 640x480"
        )
    return size


def _read_rate(text: str) -> float:
    try:
        rate = float(text)
    except ValueError:
        rate = math.nan
    if not 1.0 <= rate <= 1000.0:
        raise ValueError("frames per second from 1 to 1000, for example 30")
    return rate


def _read_format(text: str) -> str:
    name = text.upper()
    if not (len(name) == 4 and name.isascii() and name.isalnum()):
        raise ValueError("the four characters of a pixel format, for example MJPG or YUYV")
    return name


def _number(low: int, high: int, example: int, unit: str) -> Callable[[str], int | Auto]:
    def read(text: str) -> int | Auto:
        if text == "auto":
            return "auto"
        if not _is_number(text) or not low <= int(text) <= high:
            raise ValueError(
                f"auto or a whole number from {low} to {high}{unit}, for example {example}"
            )
        return int(text)

    return read


def _read_power_line(text: str) -> int | Auto:
    known: dict[str, int | Auto] = {"0": 0, "off": 0, "50": 50, "60": 60, "auto": "auto"}
    if text not in known:
        raise ValueError("50, 60, off or auto")
    return known[text]


def _is_number(text: str) -> bool:
    return text.isascii() and text.isdecimal() and len(text) <= 9


# Key of the query -> attribute of CameraSettings, and what reads its value.
_READERS: Mapping[str, tuple[str, Callable[[str], object]]] = {
    "size": ("size", _read_size),
    "rate": ("rate", _read_rate),
    "format": ("pixel_format", _read_format),
    "exposure": ("exposure", _number(1, 10_000_000, 156, " in the camera's own unit")),
    "gain": ("gain", _number(0, 1_000_000, 10, " in the camera's own unit")),
    "white_balance": ("white_balance", _number(1000, 20_000, 4600, " kelvin")),
    "focus": ("focus", _number(0, 1_000_000, 0, " in the camera's own unit")),
    "power_line": ("power_line_hz", _read_power_line),
}
