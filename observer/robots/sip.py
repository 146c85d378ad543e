"""A robot's status packets (standard SIP, types 0x32 and 0x33) in SI units. Pure."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial

from observer.robots.models import RobotSpec

STOPPED, MOVING = 0x32, 0x33
_FIXED = struct.Struct("<xHHhhhBHhHBB")
# The word has one byte for each end: a stall bit and seven segments.
BUMPERS = 7
# Maximum range; the firmware reports it where there was no echo.
SONAR_REACH_MM = 5000
_CHARGING: Mapping[int, str] = {
    0: "not charging",
    1: "bulk",
    2: "overcharge",
    3: "float",
    4: "balance",
}
_NO_TEMPERATURE = -127


@dataclass(frozen=True)
class RobotStatus:
    """One status packet; None for values that it does not contain.

    Attributes:
        raw_x, raw_y: 0 to 0x7FFF in units of the model, and raw_heading, signed 16 bits: as
            ``WheelOdometry`` takes them.
        speed_mps, turn_rate_radps: of the wheels.
        battery_v: volts.
        stalled: left and right wheel. front_bumpers, rear_bumpers: as many as are fitted.
        motors_enabled, stop_pressed, e_stalled, joystick: of the flags; None for what this model
            has no flag for.
        ranges_m: by sonar, only those that are new in this packet; None without an echo.
        sonar_overrun: the count of readings exceeds the packet, so none of them was used.
        charging: in words. temperature_c: of the electronics.
    """

    raw_x: int
    raw_y: int
    raw_heading: int
    speed_mps: float
    turn_rate_radps: float
    battery_v: float | None
    stalled: tuple[bool, bool]
    front_bumpers: tuple[bool, ...]
    rear_bumpers: tuple[bool, ...]
    motors_enabled: bool
    stop_pressed: bool | None
    e_stalled: bool | None
    joystick: bool | None
    ranges_m: Mapping[int, float | None] = field(default_factory=dict)
    sonar_overrun: bool = False
    charging: str | None = None
    temperature_c: float | None = None


def is_status(payload: bytes) -> bool:
    """Return whether a payload is a status packet, by its type."""
    return bool(payload) and payload[0] in (STOPPED, MOVING)


def decode_status(
    payload: bytes, spec: RobotSpec, front_bumpers: int = 0, rear_bumpers: int = 0
) -> RobotStatus:
    """Decode the payload of a status packet, type byte first.

    Args:
        front_bumpers, rear_bumpers: how many segments are fitted; other bits have no meaning.

    Raises:
        ValueError: it is not a status packet, or cut off before its sonar readings.
    """
    if not is_status(payload) or len(payload) < _FIXED.size:
        raise ValueError(
            f"a status packet has {_FIXED.size} bytes or more and type 32 or 33, "
            f"not {len(payload)} and {payload[:1].hex() or 'none'}"
        )
    x, y, heading, left, right, decivolts, bumps, _control, flags, _compass, count = (
        _FIXED.unpack_from(payload)
    )
    end = _FIXED.size + 3 * count
    overrun = end > len(payload)
    # After a wrong count nothing can be decoded: a false range could be taken for free space.
    tail = partial(_number, b"" if overrun else payload[end:])
    battery = tail(5, 2) or decivolts
    turn_rate = tail(8, 2, signed=True)
    charging, temperature = tail(7, 1), tail(14, 1, signed=True)
    return RobotStatus(
        raw_x=x & 0x7FFF,
        raw_y=y & 0x7FFF,
        raw_heading=heading,
        speed_mps=(left + right) / 2 * spec.speed_mmps / 1000,
        turn_rate_radps=(right - left) / 2 * spec.speed_mmps * spec.wheel_turn
        if turn_rate is None
        else math.radians(turn_rate / 10),
        battery_v=battery / 10 if battery else None,
        stalled=(bool(bumps & 1), bool(bumps & 0x100)),
        rear_bumpers=_segments(bumps >> 1, rear_bumpers),
        front_bumpers=_segments(bumps >> 9, front_bumpers),
        motors_enabled=bool(flags & 1),
        stop_pressed=_flag(flags, 5, spec),
        e_stalled=_flag(flags, 6, spec),
        joystick=_flag(flags, 9, spec),
        ranges_m={} if overrun else _ranges(payload[_FIXED.size : end], len(spec.sonars)),
        sonar_overrun=overrun,
        charging=None if charging is None else _CHARGING.get(charging),
        temperature_c=None if temperature in (None, _NO_TEMPERATURE) else float(temperature),
    )


def _number(tail: bytes, at: int, size: int, *, signed: bool = False) -> int | None:
    """Read a number after the sonar readings; older firmware may omit any part of the end."""
    if len(tail) < at + size:
        return None
    return int.from_bytes(tail[at : at + size], "little", signed=signed)


def _segments(bits: int, fitted: int) -> tuple[bool, ...]:
    return tuple(bool(bits >> each & 1) for each in range(min(fitted, BUMPERS)))


def _flag(flags: int, bit: int, spec: RobotSpec) -> bool | None:
    return bool(flags >> bit & 1) if spec.flag_bits >> bit & 1 else None


def _ranges(data: bytes, sonars: int) -> dict[int, float | None]:
    ranges: dict[int, float | None] = {}
    for at in range(0, len(data), 3):
        index, millimetres = struct.unpack_from("<BH", data, at)
        if index < sonars:
            ranges[index] = millimetres / 1000 if millimetres < SONAR_REACH_MM else None
    return ranges
