"""Network robot: odometry in; permitted speed, stop and reason out, over TCP.

We listen at ``external:HOST:PORT``, and one robot connects. ``EXTERNAL.md`` documents the messages
of both sides and what silence means to each; ``observer.robots.network.client`` implements the
robot's side with the standard library alone.
"""

from __future__ import annotations

import ipaddress
import re
import threading
import time
from collections.abc import Callable

from observer.errors import InputError
from observer.robots.contract import RobotReport, Sent
from observer.robots.models import robot_spec
from observer.robots.network.link import EXPIRES_S, ExternalLink, ExternalPort
from observer.robots.network.watch import ExternalWatch
from observer.robots.ports import EXTERNAL, shown_port

_ADDRESS = re.compile(r"(\[(?P<six>[0-9A-Fa-f:.]+)\]|(?P<name>[A-Za-z0-9_.-]+)):(?P<port>\d{1,5})")
_KEY = re.compile(r"[A-Za-z0-9_-]{16,128}")
_CLOSE_WITHIN_S = 2.0


def parse_external(text: str) -> ExternalPort:
    """Parse ``external:HOST:PORT`` or ``external:HOST:PORT?key=KEY``.

    Raises:
        InputError: it does not have this form, or lacks a key although others could connect.
    """
    shown = shown_port(text)[:80]
    where, _, query = text.removeprefix(EXTERNAL).partition("?")
    found = _ADDRESS.fullmatch(where)
    if not text.startswith(EXTERNAL) or found is None or not 1 <= int(found["port"]) <= 65535:
        raise InputError(
            f"{shown!r} is not an address for a robot to connect to; write it as "
            "external:127.0.0.1:7700"
        )
    host, port = found["six"] or found["name"], int(found["port"])
    key = query.removeprefix("key=") if query else None
    if key is not None and (not query.startswith("key=") or _KEY.fullmatch(key) is None):
        raise InputError(
            f"{shown!r}: ? must be followed by key= and 16 to 128 letters, digits, - or _"
        )
    if key is None and not _is_loopback(host):
        raise InputError(
            f"{where!r} can be reached from other machines; add a key that the robot must send, as "
            f"in external:{where}?key=KEY, or listen on 127.0.0.1"
        )
    return ExternalPort(host, port, key)


class ExternalRobot:
    """Implements ``observer.robots.contract.Robot``; listens once constructed.

    Args:
        port: ``external:HOST:PORT``, to which the robot will connect.
        model: of ``observer.robots.models``, whose limits then apply besides the robot's own.

    Raises:
        InputError: the text does not have this form, or there is no such model.
    """

    def __init__(
        self, port: str, model: str | None = None, *, clock: Callable[[], float] = time.monotonic
    ) -> None:
        where = parse_external(port)
        self._clock = clock
        self._lock = threading.Lock()
        self._watch = ExternalWatch(None if model is None else robot_spec(model))
        self._link = ExternalLink(where, self._watch, self._lock, clock)

    def report(self) -> RobotReport:
        """Return the robot's current state; callable from any thread."""
        with self._lock:
            return self._watch.report(self._clock(), EXPIRES_S)

    def enable(self) -> None:
        """Switch the motors on, at zero velocity, unless there is a fault or no connection."""
        with self._lock:
            self._watch.enable(self._clock())
        self._link.wake()

    def disable(self) -> None:
        """Command zero velocity and switch the motors off."""
        with self._lock:
            self._watch.disable()
        self._link.wake()

    def drive(self, speed_mps: float, turn_rate_radps: float) -> Sent:
        """Permit a velocity, as ``Robot.drive`` specifies."""
        now = self._clock()
        with self._lock:
            speed, turn_rate = self._watch.drive(speed_mps, turn_rate_radps, now)
        self._link.wake()
        return Sent(speed, turn_rate, now)

    def explain(self, reason: str | None) -> None:
        """Tell the robot why it may not drive as asked; None: nothing limits it."""
        with self._lock:
            changed = self._watch.explain(reason)
        if changed:
            self._link.wake()

    def stop(self) -> None:
        """Stop as hard as possible, motors off."""
        with self._lock:
            self._watch.stop()
        self._link.wake()

    def clear(self) -> None:
        """Clear the fault if its cause is gone; motors stay off."""
        with self._lock:
            self._watch.clear(self._clock())
        self._link.wake()

    def close(self) -> None:
        """Stop, disconnect, stop listening; waits for at most 2 s. Safe to call twice."""
        self.stop()
        self._link.close(_CLOSE_WITHIN_S)
        with self._lock:
            self._watch.closed()


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
