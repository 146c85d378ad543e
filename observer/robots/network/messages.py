"""Messages between a network robot and the server, as lines of text; pure.

Every message is one JSON object on one line of UTF-8 that ends in a newline, at most
``LONGEST_LINE`` bytes. ``EXTERNAL.md`` documents their contents.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from functools import partial
from typing import Any, Literal, cast

from observer.errors import DynamicObserverError
from observer.robots.contract import RobotLimits

PROTOCOL = 1
LONGEST_LINE = 4096
Mode = Literal["driven", "guarded"]
# Larger numbers are damaged or in other units.
_FAR_M, _FAST_MPS, _FAST_RADPS, _LARGE_M = 1e6, 100.0, 1000.0, 100.0
_LONGEST_TEXT = 200


class BadMessage(DynamicObserverError):
    """A line violates the protocol; the message says what it should be."""


@dataclass(frozen=True)
class Hello:
    """First message of a robot.

    Attributes:
        key: None where it sends none. radius_m: of its turning circle.
    """

    name: str
    mode: Mode
    key: str | None
    limits: RobotLimits
    radius_m: float
    width_m: float
    length_m: float


@dataclass(frozen=True)
class OdometryMessage:
    """State of the robot.

    Attributes:
        sequence: increases with each. time: seconds on the robot's own monotonic clock.
        x, y, yaw: wheel odometry, metres and radians, from any origin.
        enabled: whether its motors are on. permit: sequence of the newest permit it has, 0 before
            the first.
        wanted: speed and turn rate that it would drive by itself; only from a guarded robot.
        fault: one sentence on why it cannot go on.
    """

    sequence: int
    time: float
    x: float
    y: float
    yaw: float
    speed_mps: float
    turn_rate_radps: float
    enabled: bool
    permit: int
    wanted: tuple[float, float] | None
    battery_v: float | None
    fault: str | None


@dataclass(frozen=True)
class Permit:
    """Velocity that the robot may drive from now on.

    Attributes:
        stop: stop as hard as possible, motors off. reason: why it differs from the request.
    """

    speed_mps: float
    turn_rate_radps: float
    stop: bool
    reason: str | None


class Lines:
    """Splits received bytes into lines; never buffers more than one of them."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Yield the lines that are complete now, without their newlines.

        Raises:
            BadMessage: a line is longer than any message.
        """
        *lines, self._rest = (self._rest + data).split(b"\n")
        for line in (*lines, self._rest):
            if len(line) > LONGEST_LINE:
                raise BadMessage(
                    f"a message may have at most {LONGEST_LINE} bytes and must end with a newline"
                )
        yield from (line for line in lines if line.strip())


def permit_line(permit: Permit, sequence: int, now: float, expires_s: float) -> bytes:
    """Encode a permit; ``now`` is our monotonic clock."""
    return _line(
        {
            "type": "permit",
            "sequence": sequence,
            "time": round(now, 6),
            **asdict(permit),
            "expires_ms": round(1000 * expires_s),
        }
    )


def welcome_line(interval_s: float, expires_s: float) -> bytes:
    """Encode the answer to an accepted hello."""
    return _line(
        {
            "type": "welcome",
            "protocol": PROTOCOL,
            "interval_ms": round(1000 * interval_s),
            "expires_ms": round(1000 * expires_s),
        }
    )


def refusal_line(sentence: str) -> bytes:
    """Encode a refusal, sent before the connection is closed."""
    return _line({"type": "refused", "sentence": sentence})


def parse_hello(line: bytes) -> Hello:
    """Parse the first line of a robot.

    Raises:
        BadMessage: it is not a hello of this protocol.
    """
    data = _object(line, "hello")
    if data.get("protocol") != PROTOCOL or isinstance(data.get("protocol"), bool):
        raise BadMessage(f"hello: protocol must be {PROTOCOL}, the only supported version")
    mode = data.get("mode", "driven")
    if mode not in ("driven", "guarded"):
        raise BadMessage("hello: mode must be driven or guarded")
    limits, outline = _part(data, "limits"), _part(data, "outline")
    key = data.get("key")
    if key is not None and not isinstance(key, str):
        raise BadMessage("hello: key must be text")
    return Hello(
        name=_text(data, "name", "hello"),
        mode=cast(Mode, mode),
        key=key,
        limits=RobotLimits(
            *(
                _positive(limits, part.name, _FAST_RADPS, "hello: limits")
                for part in fields(RobotLimits)
            )
        ),
        **{
            part: _positive(outline, part, _LARGE_M, "hello: outline")
            for part in ("radius_m", "width_m", "length_m")
        },
    )


def parse_odometry(line: bytes) -> OdometryMessage:
    """Parse any later line of a robot.

    Raises:
        BadMessage: it is not odometry of this protocol.
    """
    data = _object(line, "odometry")
    number = partial(_number, data, what="odometry")
    wanted = data.get("wanted")
    if wanted is not None and not isinstance(wanted, dict):
        raise BadMessage("odometry: wanted must be an object with speed_mps and turn_rate_radps")
    enabled = data.get("enabled")
    if not isinstance(enabled, bool):
        raise BadMessage("odometry: enabled must be true or false")
    return OdometryMessage(
        sequence=_count(data, "sequence"),
        time=number("time", math.inf),
        x=number("x", _FAR_M),
        y=number("y", _FAR_M),
        yaw=number("yaw", _FAR_M),
        speed_mps=number("speed_mps", _FAST_MPS),
        turn_rate_radps=number("turn_rate_radps", _FAST_RADPS),
        enabled=enabled,
        permit=_count(data, "permit"),
        wanted=None
        if wanted is None
        else (
            _number(wanted, "speed_mps", _FAST_MPS, "odometry: wanted"),
            _number(wanted, "turn_rate_radps", _FAST_RADPS, "odometry: wanted"),
        ),
        battery_v=None if data.get("battery_v") is None else number("battery_v", 1000.0),
        fault=None if data.get("fault") is None else _text(data, "fault", "odometry"),
    )


def _line(message: dict[str, Any]) -> bytes:
    return json.dumps(message, allow_nan=False).encode() + b"\n"


def _object(line: bytes, kind: str) -> dict[str, Any]:
    try:
        data = json.loads(line)
    except (ValueError, RecursionError):
        raise BadMessage("a message must be one JSON object on one line of UTF-8") from None
    if not isinstance(data, dict) or data.get("type") != kind:
        raise BadMessage(f'expected a message with "type": "{kind}"')
    return data


def _part(data: dict[str, Any], key: str) -> dict[str, Any]:
    part = data.get(key)
    if not isinstance(part, dict):
        raise BadMessage(f"hello: {key} must be an object")
    return part


def _number(data: dict[str, Any], key: str, most: float, what: str) -> float:
    value = data.get(key)
    try:
        # JSON integers may have any number of digits.
        number = math.nan if isinstance(value, bool | str | None) else float(value)
    except (TypeError, OverflowError):
        number = math.nan
    if not (math.isfinite(number) and abs(number) <= most):
        raise BadMessage(f"{what}: {key} must be a finite number within ±{most:g}")
    return number


def _positive(data: dict[str, Any], key: str, most: float, what: str) -> float:
    number = _number(data, key, most, what)
    if not number > 0:
        raise BadMessage(f"{what}: {key} must be above 0")
    return number


def _count(data: dict[str, Any], key: str) -> int:
    value = data.get(key)
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < 2**63:
        raise BadMessage(f"odometry: {key} must be a whole number of at least 0")
    return value


def _text(data: dict[str, Any], key: str, what: str) -> str:
    value = data.get(key)
    if not isinstance(value, str) or not value.isprintable() or not 0 < len(value) <= _LONGEST_TEXT:
        raise BadMessage(f"{what}: {key} must be 1 to {_LONGEST_TEXT} printable characters")
    return value
