"""Checks for driving: the priority of the drive loop, and the ports that the rig names."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from app.doctor.finding import Finding, Section
from app.drive.priority import permitted_priority
from app.settings import RIG_FILE, Settings
from observer.errors import InputError
from observer.machine import Machine
from observer.rig.rig import ROLES, Rig, Role
from observer.rig.rig_file import read_rig
from observer.robots.ports import shown_port
from observer.robots.serial_ports import port_trouble

_SECTION = Section("Robots")
_ALLOW_IT = (
    "allow it with the line '$USER - rtprio 1' in a file below /etc/security/limits.d and sign in "
    "again (LimitRTPRIO=1 in a service of systemd, --ulimit rtprio=1 for a container)"
)


def examine_robots(settings: Settings | str, machine: Machine) -> Iterator[Finding]:
    """Check the robots' ports without connecting, opening or changing anything.

    Args:
        settings: a sentence if there are none; the rig is then unknown.
    """
    rig = Rig()
    if not isinstance(settings, str):
        found = _rig(settings.data / RIG_FILE)
        if isinstance(found, Finding):
            yield found
        else:
            rig = found
    # Without robots there is nothing to fix.
    yield _priority(machine, driven=bool(rig.ports))
    for role in ROLES:
        if role in rig.ports:
            yield _port(role, rig.ports[role], machine)


def _rig(file: Path) -> Rig | Finding:
    try:
        return read_rig(file.read_text(encoding="utf-8"), RIG_FILE)
    except FileNotFoundError:
        return Rig()
    except (InputError, UnicodeDecodeError) as error:
        return _SECTION.warning(f"the rig is unknown: {error}")
    except OSError as error:
        # An unusable data folder is reported under its own heading.
        return _SECTION.warning(f"the rig is unknown: {file} cannot be read ({error.strerror})")


def _priority(machine: Machine, *, driven: bool) -> Finding:
    permitted = permitted_priority(machine.root)
    if permitted == "realtime":
        return _SECTION.ok("the drive loop is permitted to use real-time priority")
    if permitted is None:
        return _SECTION.ok(
            "it is unknown on this system whether the drive loop is permitted to use real-time "
            "priority"
        )
    instead = (
        "it only takes precedence over ordinary programs"
        if permitted == "raised"
        else "it is late when the computer is busy"
    )
    finding = _SECTION.warning if driven else _SECTION.ok
    return finding(
        f"the drive loop is not permitted to use real-time priority, so {instead}; {_ALLOW_IT}"
    )


def _port(role: Role, port: str, machine: Machine) -> Finding:
    shown = shown_port(port)
    if not port.startswith(("/", ".")):
        return _SECTION.ok(f"the {role} is connected via {shown} (not tested here)")
    file = machine.root / port.removeprefix("/") if port.startswith("/") else Path(port)
    if not file.exists():
        return _SECTION.warning(
            f"the {role}'s port {shown} does not exist; plug in its adapter, or choose another "
            "port under Robots"
        )
    trouble = port_trouble(file, shown, machine)
    if trouble is None:
        return _SECTION.ok(f"the {role}'s port {shown} is present")
    return _SECTION.warning(f"the {role}'s port: {trouble}")
