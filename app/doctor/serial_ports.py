"""Serial ports, by which robots are driven."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from app.doctor.finding import Finding
from app.doctor.machine import Machine
from observer.sources.cameras.device_files import permission_advice

_SECTION = "Serial ports"
# USB adapters and boards; the ports of the mainboard exist whether or not anything is behind them.
_ON_USB = re.compile(r"tty(USB|ACM)\d+")


@dataclass(frozen=True)
class SerialPort:
    """One port.

    Attributes:
        path: as in ``/dev/ttyUSB0``. by_id: its name by maker and serial number, None without one.
        description: what it says of itself, None where it says nothing.
        usable: whether this user may read and write it.
    """

    path: str
    by_id: str | None
    description: str | None
    usable: bool


def examine_serial_ports(machine: Machine) -> tuple[list[Finding], tuple[SerialPort, ...]]:
    """What was found, and the ports it was found on. None is opened: that resets some boards."""
    described = machine.ports()
    if sys.platform != "linux":
        return _named_by_pyserial(described)
    ports: list[SerialPort] = []
    findings: list[Finding] = []
    by_id = _by_id(machine.root)
    for file in _on_usb(machine.root):
        path = f"/dev/{file.name}"
        says = described.get(path)
        port = SerialPort(
            path,
            by_id.get(file.name),
            None if says in (None, "n/a") else says,
            machine.access.may_use(file),
        )
        ports.append(port)
        findings.append(_finding(port, file, machine))
    if not ports:
        text = (
            "no serial port on USB, so no robot can be connected; "
            "in a container hand it in with --device /dev/ttyUSB0 --group-add dialout"
        )
        findings.append(Finding(_SECTION, "ok", text))
    return findings, tuple(ports)


def _named_by_pyserial(
    described: Mapping[str, str],
) -> tuple[list[Finding], tuple[SerialPort, ...]]:
    """Where ports are no device files with groups, such as COM3, pyserial alone knows them."""
    ports = tuple(SerialPort(path, None, says, usable=True) for path, says in described.items())
    findings = [Finding(_SECTION, "ok", f"{each.path} ({each.description})") for each in ports]
    return findings or [Finding(_SECTION, "ok", "no serial port")], ports


def _finding(port: SerialPort, file: Path, machine: Machine) -> Finding:
    name = f"{port.path} ({port.description})" if port.description else port.path
    details = (f"stays the same on every port: {port.by_id}",) if port.by_id else ()
    if port.usable:
        return Finding(_SECTION, "ok", name, details)
    try:
        advice = permission_advice(file, machine.root, machine.user)
    except OSError:
        advice = f"{port.path} may not be used by you"
    return Finding(_SECTION, "warning", advice, details)


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
