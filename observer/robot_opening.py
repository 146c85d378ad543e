"""Opening of the robot that a text names."""

from __future__ import annotations

import re
import time
from collections.abc import Callable

from observer.errors import InputError
from observer.robots.contract import Robot
from observer.robots.models import robot_spec
from observer.robots.ports import COPPELIASIM, EXTERNAL, SOCKET, shown_port

_HOST = r"(?:\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9_.-]+)"
_HOST_AND_PORT = re.compile(rf"{_HOST}:(?P<port>\d{{1,5}})(?P<rest>/.*)?")
_FORMS = (
    "a robot's port is a device such as /dev/ttyUSB0, or socket://HOST:8101, external:HOST:PORT or "
    "coppeliasim:HOST:PORT/OBJECT"
)


def open_robot(
    port: str, model: str | None = None, *, clock: Callable[[], float] = time.monotonic
) -> Robot:
    """Open the robot at a port; from then on it connects by itself, with motors off.

    Args:
        port: a device's path or ``socket://HOST:PORT`` (ARCOS), ``external:HOST:PORT`` (a robot
            of your own connects there) or ``coppeliasim:HOST:PORT/OBJECT``.
        model: one of ``observer.robots.models``; None: as the robot reports.
        clock: the host's monotonic clock.

    Raises:
        InputError: the text does not name a port, or there is no such model.
    """
    check_port(port)
    if model is not None:
        robot_spec(model)
    # Imported only when needed: each module loads the libraries of its own kind of robot.
    if port.startswith(EXTERNAL):
        from observer.robots.network.robot import ExternalRobot

        return ExternalRobot(port, model, clock=clock)
    if port.startswith(COPPELIASIM):
        from observer.coppeliasim.robot import open_coppelia_robot

        return open_coppelia_robot(port, model, clock=clock)
    from observer.robots.pioneer import Pioneer

    return Pioneer(port, model, clock=clock)


def check_port(port: str) -> None:
    """Check that a text names a port, without opening anything.

    Raises:
        InputError: it does not.
    """
    if not port or any(ord(each) < 32 or ord(each) == 127 for each in port):
        raise InputError(f"{_FORMS}, not {_quoted(port)}")
    if port.startswith(SOCKET):
        _check_address(port)
    elif port.startswith(EXTERNAL):
        from observer.robots.network.robot import parse_external

        parse_external(port)
    elif port.startswith(COPPELIASIM):
        from observer.coppeliasim.address import parse_robot

        parse_robot(port)
    elif not re.match(r"\.{0,2}/[^/]", port):
        raise InputError(f"{_FORMS}, not {_quoted(port)}")


def _check_address(port: str) -> None:
    found = _HOST_AND_PORT.fullmatch(port.removeprefix(SOCKET))
    if found is None or not 1 <= int(found["port"]) <= 65535:
        raise InputError(f"{_quoted(port)} lacks a host or a port from 1 to 65535; {_FORMS}")
    if (found["rest"] or "/") != "/":
        raise InputError(f"{_quoted(port)} has extra text after its port; {_FORMS}")


def _quoted(port: str) -> str:
    return repr(shown_port(port)[:80])
