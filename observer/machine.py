"""The computer that devices are plugged into; tests substitute another one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from observer.sources.cameras.device_files import User
from observer.sources.cameras.v4l2.device import DeviceAccess, LinuxAccess


def described_ports() -> Mapping[str, str]:
    """Return the serial ports that pyserial finds, with their descriptions."""
    from serial.tools.list_ports import comports  # type: ignore[import-untyped]

    return {port.device: port.description for port in comports()}


@dataclass(frozen=True)
class Machine:
    """Places where devices are looked for.

    Attributes:
        root: of the file system. access: the kernel, for device files.
        user: the one that advice on permissions addresses; None for this process's user.
        ports: serial ports and their descriptions.
    """

    root: Path = Path("/")
    access: DeviceAccess = field(default_factory=LinuxAccess)
    user: User | None = None
    ports: Callable[[], Mapping[str, str]] = described_ports
