"""Messages of a client on the drive socket, parsed without trust."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from app.contract.values import JsonObject
from app.http.sockets.connections import BadMessage, json_object
from observer.rig.rig import ROLES, Role

# Upper limit of the integers that JavaScript represents exactly.
_LARGEST_NUMBER = 2**53


@dataclass(frozen=True)
class Take:
    role: Role
    takeover: bool


@dataclass(frozen=True)
class Release:
    role: Role


@dataclass(frozen=True)
class Command:
    """Velocity, or a heartbeat if there is none.

    Attributes:
        stamp: the client's clock, seconds.
        velocity: m/s forward and rad/s to the left.
    """

    role: Role
    sequence: int
    stamp: float
    velocity: tuple[float, float] | None


@dataclass(frozen=True)
class Unusable:
    """Command with a missing or non-numeric value; it is ignored."""

    role: Role | None
    sequence: int | None
    sentence: str


@dataclass(frozen=True)
class Stop:
    pass


@dataclass(frozen=True)
class Pong:
    """Answer to a ping. ``stamp``: the client's clock, seconds."""

    number: int
    stamp: float


Message = Take | Release | Command | Unusable | Stop | Pong


def read_message(text: str) -> Message:
    """Parse a text message.

    Raises:
        BadMessage: this socket has no such message. A command without a velocity or a time is valid
            and comes back as ``Unusable``.
    """
    expected = "the message does not match the description of /api/drive"
    data = json_object(text, expected)
    kind, role = data.get("type"), _role(data.get("role"))
    if kind == "stop":
        return Stop()
    if kind in ("drive", "present"):
        return _command(data, role, moves=kind == "drive")
    if kind == "pong":
        number, stamp = _count(data.get("id")), _number(data.get("time"))
        if number is not None and stamp is not None:
            return Pong(number, stamp / 1000)
    elif kind == "take" and role is not None and isinstance(data.get("takeover", False), bool):
        return Take(role, data.get("takeover", False))
    elif kind == "release" and role is not None:
        return Release(role)
    raise BadMessage(expected)


def _command(data: JsonObject, role: Role | None, *, moves: bool) -> Command | Unusable:
    sequence, stamp = _count(data.get("sequence")), _number(data.get("time"))
    if role is None:
        return Unusable(None, sequence, f"role must be {' or '.join(ROLES)}")
    if sequence is None:
        return Unusable(role, None, "sequence must be a whole number of at least 0")
    if stamp is None:
        return Unusable(role, sequence, "time must be performance.now(), a finite number")
    if not moves:
        return Command(role, sequence, stamp / 1000, None)
    speed, turn_rate = _number(data.get("speed_mps")), _number(data.get("turn_rate_radps"))
    if speed is None or turn_rate is None:
        return Unusable(role, sequence, "speed_mps and turn_rate_radps must be finite numbers")
    return Command(role, sequence, stamp / 1000, (speed, turn_rate))


def _role(value: Any) -> Role | None:
    return next((role for role in ROLES if role == value), None)


def _number(value: Any) -> float | None:
    """Return a finite number, else None; True and text are not numbers."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    if not math.isfinite(value) if isinstance(value, float) else abs(value) > _LARGEST_NUMBER:
        return None
    return float(value)


def _count(value: Any) -> int | None:
    if isinstance(value, bool) or not isinstance(value, int):
        return None
    return value if 0 <= value <= _LARGEST_NUMBER else None
