"""Serial ports for driving robots."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from observer.machine import Machine
from observer.sources.cameras.device_files import permission_advice

# USB adapters and boards; mainboard ports exist whether or not anything is connected to them.
_ON_USB = re.compile(r"tty(USB|ACM)\d+")


@dataclass(frozen=True)
class SerialPort:
    """One port.

    Attributes:
        path: as in ``/dev/ttyUSB0``. by_id: its name by maker and serial number, None without one.
        description: as reported by the device, None without one.
        trouble: why this user may not read and write it, and what to do; None: it may be used.
    """

    path: str
    by_id: str | None
    description: str | None
    trouble: str | None

    @property
    def usable(self) -> bool:
        """Return whether this user may read and write it."""
        return self.trouble is None


def find_serial_ports(machine: Machine) -> tuple[SerialPort, ...]:
    """Return the USB ports, by name. None is opened, as that resets some boards."""
    described = {path: None if says == "n/a" else says for path, says in machine.ports().items()}
    if sys.platform != "linux":
        # Only pyserial knows ports that are not device files with groups, such as COM3.
        return tuple(SerialPort(path, None, says, None) for path, says in described.items())
    by_id = _by_id(machine.root)
    return tuple(
        SerialPort(
            f"/dev/{file.name}",
            by_id.get(file.name),
            described.get(f"/dev/{file.name}"),
            port_trouble(file, f"/dev/{file.name}", machine),
        )
        for file in _on_usb(machine.root)
    )


def port_trouble(file: Path, shown: str, machine: Machine) -> str | None:
    """Return why a port's file may not be read and written, and what to do; None if it may.

    Args:
        shown: name of the port for people.
    """
    if machine.access.may_use(file):
        return None
    try:
        return permission_advice(file.resolve(), machine.root, machine.user)
    except (OSError, ValueError):
        return f"you have no permission to use {shown}"


def _on_usb(root: Path) -> Iterator[Path]:
    try:
        files = sorted((root / "dev").iterdir())
    except OSError:
        return
    yield from (file for file in files if _ON_USB.fullmatch(file.name))


def _by_id(root: Path) -> dict[str, str]:
    folder = root / "dev" / "serial" / "by-id"
    try:
        return {link.resolve().name: f"/dev/serial/by-id/{link.name}" for link in folder.iterdir()}
    except OSError:
        return {}
