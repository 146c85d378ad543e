"""All checks, one after the other."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from app.doctor.address import examine_address
from app.doctor.cameras import examine_cameras
from app.doctor.data_folder import examine_data
from app.doctor.finding import Finding, Section
from app.doctor.robots import examine_robots
from app.doctor.serial_ports import examine_serial_ports
from app.doctor.software import examine_software, program_version
from app.settings import Settings
from observer.machine import Machine
from observer.robots.serial_ports import SerialPort
from observer.sources.cameras.devices import CameraDevice


@dataclass(frozen=True)
class Examination:
    """All findings in the order of the report, and the devices they are about."""

    findings: tuple[Finding, ...]
    cameras: tuple[CameraDevice, ...]
    serial_ports: tuple[SerialPort, ...]

    @property
    def hindered(self) -> bool:
        """Return whether a finding would prevent the start."""
        return any(finding.level == "problem" for finding in self.findings)

    def as_json(self) -> dict[str, Any]:
        """Return plain values for scripts."""
        return {
            "version": program_version(),
            "hindered": self.hindered,
            "findings": [asdict(finding) for finding in self.findings],
            "cameras": [asdict(camera) for camera in self.cameras],
            "serial_ports": [asdict(port) | {"usable": port.usable} for port in self.serial_ports],
        }


def examine(settings: Settings | str, machine: Machine) -> Examination:
    """Run all checks; they change nothing, and a failed check does not prevent the others.

    Args:
        settings: the server's settings, or one sentence that says why there are none.
        machine: the machine to examine.
    """
    cameras, devices = examine_cameras(machine)
    serial, ports = examine_serial_ports(machine)
    robots = examine_robots(settings, machine)
    findings = [*examine_software(), *cameras, *serial, *robots]
    if isinstance(settings, str):
        findings.append(Section("Settings").problem(settings))
    else:
        findings += [*examine_data(settings), examine_address(settings)]
    return Examination(tuple(findings), devices, ports)
