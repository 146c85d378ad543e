"""Serial ports for robots: faults that would prevent their use."""

from __future__ import annotations

import sys

from app.doctor.finding import Finding, Section
from observer.machine import Machine
from observer.robots.serial_ports import SerialPort, find_serial_ports

_SECTION = Section("Serial ports")


def examine_serial_ports(machine: Machine) -> tuple[list[Finding], tuple[SerialPort, ...]]:
    """Return the findings, and the ports that they are about."""
    ports = find_serial_ports(machine)
    findings = [_finding(port) for port in ports]
    if not ports:
        text = (
            "no USB serial port, so no robot can be connected by cable; in a container pass it "
            "with --device /dev/ttyUSB0 --group-add dialout"
        )
        findings.append(_SECTION.ok(text if sys.platform == "linux" else "no serial port"))
    return findings, ports


def _finding(port: SerialPort) -> Finding:
    name = f"{port.path} ({port.description})" if port.description else port.path
    details = (f"persistent name: {port.by_id}",) if port.by_id else ()
    if port.trouble is None:
        return _SECTION.ok(name, details)
    return _SECTION.warning(port.trouble, details)
