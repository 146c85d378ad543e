"""A robot of one's own: odometry in; permitted speed, stop and reason out, over TCP.

We listen at ``external:HOST:PORT``, one robot connects. On loopback anybody on this machine may;
any other address needs a key (``external:0.0.0.0:7700?key=...``) that the robot gives. The key
crosses the network in the clear: use a network of the robot's own, or a tunnel.

Both sides say JSON objects, one a line (UTF-8, newline, at most 4096 bytes). Numbers are finite,
in m/s, rad/s, metres, radians, seconds; keys that are not known are ignored; anything else that
is not as below ends the connection, with one line ``{"type": "refused", "sentence": ...}``.

The robot begins, within 2 s::

    {"type": "hello", "protocol": 1, "name": "Robbie", "mode": "driven", "key": "...",
     "limits": {"speed_mps": 0.5, "turn_rate_radps": 1.5,
                "acceleration_mps2": 0.5, "turn_acceleration_radps2": 2.0},
     "outline": {"radius_m": 0.3, "width_m": 0.4, "length_m": 0.5}}

and is answered ``{"type": "welcome", "protocol": 1, "interval_ms": 50, "expires_ms": 250}``. From
then on it tells how it is, 10 times a second or more::

    {"type": "odometry", "sequence": 17, "time": 12.34, "x": 0.1, "y": 0.0, "yaw": 0.02,
     "speed_mps": 0.2, "turn_rate_radps": 0.0, "enabled": true, "permit": 391,
     "wanted": {"speed_mps": 0.4, "turn_rate_radps": 0.0}, "battery_v": 12.4, "fault": null}

``sequence`` rises, ``time`` is a clock of the robot's that never goes back: what is older than
what was heard already is ignored. ``x y yaw`` may begin anywhere. ``enabled``: its motors are on.
``permit``: sequence of the newest permit that it has. ``wanted``, ``battery_v``, ``fault`` (one
sentence, while it cannot go on) may be missing. Every 50 ms, and at once when it changes, we say::

    {"type": "permit", "sequence": 392, "time": 5021.7, "speed_mps": 0.2, "turn_rate_radps": 0.0,
     "stop": false, "reason": "1.2 m before an obstacle", "expires_ms": 250}

What a robot must do:

- ``stop`` true: stop as hard as it can, motors off. False: motors on, drive this velocity.
- ``mode`` ``driven``: the velocity is what to drive. ``guarded``: the robot drives by itself and
  tells in ``wanted`` what it would drive; the velocity is what it may drive of it.
- ``time`` is our monotonic clock. A permit counts until ``expires_ms`` after it was *said*, not
  after it was read: by (arrival - ``time``), less the smallest such difference of the last
  seconds, the robot knows how long it waited on its way.
- A permit whose sequence is not above the last one is ignored. When the newest one has expired,
  or the connection ends: stop, ``enabled`` false, and take nothing that moves until a permit with
  ``stop`` true has come: a link that recovers must not set the robot moving.

And what we do: without odometry for 0.5 s, without a newer ``permit`` confirmed for 0.7 s, with
motors that go off by themselves, with ``fault``, or with the connection lost, the robot has a
fault: ``stop`` until somebody clears it. It may connect again by itself, and then stands.

``observer.robots.external_client`` is all this from the robot's side, on the standard library.
"""

from __future__ import annotations

import ipaddress
import re
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from observer.errors import InputError
from observer.robots.contract import RobotReport, Sent
from observer.robots.external_link import EXPIRES_S, ExternalLink
from observer.robots.external_watch import ExternalWatch
from observer.robots.models import robot_spec

PREFIX = "external:"
_ADDRESS = re.compile(r"(\[(?P<six>[0-9A-Fa-f:.]+)\]|(?P<name>[A-Za-z0-9_.-]+)):(?P<port>\d{1,5})")
_KEY = re.compile(r"[A-Za-z0-9_-]{16,128}")
_CLOSE_WITHIN_S = 2.0


@dataclass(frozen=True)
class ExternalPort:
    """Where to listen, and the key that a robot must give; None: none."""

    host: str
    port: int
    key: str | None


def parse_external(text: str) -> ExternalPort:
    """Of ``external:HOST:PORT`` or ``external:HOST:PORT?key=KEY``.

    Raises:
        InputError: it is not of this form, or a key is missing where others could connect.
    """
    where, _, query = text.removeprefix(PREFIX).partition("?")
    found = _ADDRESS.fullmatch(where)
    if not text.startswith(PREFIX) or found is None or not 1 <= int(found["port"]) <= 65535:
        raise InputError(
            f"{_without_key(text)!r} names no place for a robot to connect to; write it as "
            f"external:127.0.0.1:7700"
        )
    host, port = found["six"] or found["name"], int(found["port"])
    key = query.removeprefix("key=") if query else None
    if key is not None and (not query.startswith("key=") or _KEY.fullmatch(key) is None):
        raise InputError(
            f"{_without_key(text)!r}: behind ? stands key= and 16 to 128 letters, digits, - or _"
        )
    if key is None and not _is_loopback(host):
        raise InputError(
            f"{where!r} can be reached by others; add a key that the robot gives, as in "
            f"external:{where}?key=KEY, or listen on 127.0.0.1"
        )
    return ExternalPort(host, port, key)


def open_external(
    spec: str, model: str | None = None, *, clock: Callable[[], float] = time.monotonic
) -> ExternalRobot:
    """The robot that will connect to ``external:HOST:PORT``; listens from now on.

    Args:
        model: of ``observer.robots.models``, whose limits then hold besides the robot's own.

    Raises:
        InputError: the text is not of this form, or there is no such model.
    """
    return ExternalRobot(parse_external(spec), model, clock)


class ExternalRobot:
    """Fulfils ``observer.robots.contract.Robot``; see the module."""

    def __init__(
        self,
        port: ExternalPort,
        model: str | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._watch = ExternalWatch(None if model is None else robot_spec(model))
        self._link = ExternalLink(port.host, port.port, port.key, self._watch, self._lock, clock)

    def report(self) -> RobotReport:
        """How it is; from any thread."""
        with self._lock:
            return self._watch.report(self._clock(), EXPIRES_S)

    def enable(self) -> None:
        """Motors on, at zero velocity; not while it is not connected or has a fault."""
        with self._lock:
            self._watch.enable(self._clock())
        self._link.wake()

    def disable(self) -> None:
        """Zero velocity, motors off."""
        with self._lock:
            self._watch.disable()
        self._link.wake()

    def drive(self, speed_mps: float, turn_rate_radps: float) -> Sent:
        """Permit this velocity until the next one, for ``SETPOINT_FRESH_S`` at most.

        Args:
            speed_mps, turn_rate_radps: finite; anything else is taken for zero.

        Returns:
            What it is clamped to; zero while it has a fault, is not connected or its motors are
            off.
        """
        now = self._clock()
        with self._lock:
            speed, turn_rate = self._watch.drive(speed_mps, turn_rate_radps, now)
        self._link.wake()
        return Sent(speed, turn_rate, now)

    def explain(self, reason: str | None) -> None:
        """Tell the robot why it may not drive as asked; None: nothing keeps it back."""
        with self._lock:
            changed = self._watch.explain(reason)
        if changed:
            self._link.wake()

    def stop(self) -> None:
        """Stop as hard as it can, motors off."""
        with self._lock:
            self._watch.stop()
        self._link.wake()

    def clear(self) -> None:
        """Forget the fault, if what caused it is over; motors stay off."""
        with self._lock:
            self._watch.clear(self._clock())
        self._link.wake()

    def close(self) -> None:
        """Stop, end the connection, listen no more; waits for at most 2 s. Safe to call twice."""
        self.stop()
        self._link.close(_CLOSE_WITHIN_S)
        with self._lock:
            self._watch.closed()


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _without_key(text: str) -> str:
    from observer.robots.opening import shown_port

    return shown_port(text)[:80]
