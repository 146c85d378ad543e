"""The cameras and serial ports of the server's machine, as reported to clients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from app.contract.values import means


@dataclass(frozen=True)
class DeviceMode:
    pixel_format: Annotated[str, means("Four characters, as in MJPG.")]
    width: int
    height: int
    rates: Annotated[Sequence[float], means("Images per second, the highest first.")]


@dataclass(frozen=True)
class DeviceControl:
    name: str
    minimum: int
    maximum: int
    step: int
    default: int


@dataclass(frozen=True)
class VideoDevice:
    path: str
    by_path: Annotated[str | None, means("Persistent path, by the port it is plugged into.")]
    card: str | None
    trouble: Annotated[str | None, means("Why it cannot be used, and what to do.")]
    modes: Sequence[DeviceMode]
    controls: Sequence[DeviceControl]


@dataclass(frozen=True)
class SerialPortNow:
    path: str
    by_id: Annotated[str | None, means("Persistent path, by maker and serial number.")]
    description: Annotated[str | None, means("Description reported by the product.")]
    usable: Annotated[bool, means("Whether the server's user may open it.")]
    trouble: Annotated[str | None, means("Why it cannot be used, and what to do.")]


@dataclass(frozen=True)
class Devices:
    cameras: Sequence[VideoDevice]
    serial_ports: Annotated[
        Sequence[SerialPortNow], means("USB serial ports, to which robots can be connected.")
    ]
    hints: Annotated[
        Sequence[str], means("Hints, for example on the bandwidth of two cameras on one bus.")
    ]
