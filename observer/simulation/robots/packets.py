"""Data of the packets that a robot sends; ``observer.robots.arcos`` frames them.

Layouts are those of MobileRobots' ARCOS and AmigOS manuals. This is written independently of the
driver's decoder, so that a mistake in either one shows.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping

from observer.robots.models import RobotSpec
from observer.simulation.robots.chassis import Wheels
from observer.simulation.robots.faults import Faults
from observer.simulation.robots.motors import (
    HARDEST_MPS2,
    HARDEST_RADPS2,
    STALL_WAIT_S,
    MotionLimits,
)

# Sonars per array: those of one array fire in turn, the arrays in parallel.
SONAR_ARRAY = 8
STRANGE = (0x98, 0xB0, 0xB8)
_STATUS_STATIONARY, _STATUS_MOVES = 0x32, 0x33
_CONFIG_REPLY, _ENCODER_REPLY, _IO_REPLY = 0x20, 0x90, 0xF0
# Below these speeds a robot counts as standing.
_STATIONARY_MPS, _STATIONARY_RADPS = 0.002, 0.004
_TICKS_PER_TURN = 500


def status_data(
    spec: RobotSpec,
    wheels: Wheels,
    odometry: tuple[float, float, float],
    faults: Faults,
    *,
    stall: int,
    flags: int,
    battery_dv: int,
    echoes: Mapping[int, int],
) -> bytes:
    """Return a standard status packet.

    Args:
        odometry: x, y (m) and yaw (rad).
        stall: bit 0 left wheel, 8 right wheel, 1-7 rear and 9-15 front bumpers.
        echoes: new sonar ranges in mm by index.
    """
    x, y, yaw = odometry
    speed, turn_rate = wheels.speed_mps, wheels.turn_rate_radps
    moves = abs(speed) > _STATIONARY_MPS or abs(turn_rate) > _STATIONARY_RADPS
    ahead, across = speed * 1000, turn_rate / spec.wheel_turn
    fixed = struct.pack(
        "<BHHhhhBHhHBB",
        _STATUS_MOVES if moves else _STATUS_STATIONARY,
        round(x * 1000 / spec.distance_mm) & 0x7FFF,
        round(y * 1000 / spec.distance_mm) & 0x7FFF,
        round(math.remainder(yaw, 2 * math.pi) / spec.angle_rad),
        _clamped16((ahead - across) / spec.speed_mmps),
        _clamped16((ahead + across) / spec.speed_mmps),
        *(min(255, battery_dv), stall & 0xFFFF, 0, flags & 0xFFFF, 0),
        255 if faults.sonar_overrun else len(echoes),
    )
    sonar = b"".join(struct.pack("<BH", index, value) for index, value in echoes.items())
    # Gripper, analog port and its value, digital in and out.
    ports = bytes(5)
    if faults.short_status:
        return fixed + sonar + ports
    # Fault flags, lateral velocity; the battery once more, in the same unit but wider.
    more = struct.pack(
        "<HBhHhbB",
        battery_dv,
        faults.charge_state,
        _clamped16(math.degrees(turn_rate) * 10),
        *(0, 0),
        -127 if faults.temperature_c is None else faults.temperature_c,
        faults.state_of_charge,
    )
    return fixed + sonar + ports + more


def encoder_data(wheels: Wheels) -> bytes:
    """Return the encoder ticks of both wheels, whose diameter is 195 mm."""
    per_m = _TICKS_PER_TURN / (math.pi * 0.195)
    distances = (round(wheel_m * per_m) for wheel_m in (wheels.left_m, wheels.right_m))
    return bytes([_ENCODER_REPLY]) + struct.pack("<ii", *distances)


def io_data() -> bytes:
    """Return the answer to IOREQUEST, all ports at 0."""
    return bytes([_IO_REPLY]) + bytes(21)


def config_data(
    spec: RobotSpec,
    limits: MotionLimits,
    *,
    subtype: str,
    name: str,
    host_baud: int,
    watchdog_s: float,
    bumpers: int,
) -> bytes:
    """Return a robot's settings with every field that the manuals name.

    Speeds in mm/s and deg/s, accelerations per second.

    Args:
        host_baud: index of the baud rate. bumpers: number at each end.
    """
    rear_sonar = len(spec.sonars) > SONAR_ARRAY
    return (
        bytes([_CONFIG_REPLY])
        + b"".join(_text(word) for word in ("Pioneer", subtype, "0000"))
        + struct.pack(
            "<BHHHHH", 0, _degrees(spec.turn_rate_max_radps), _milli(spec.speed_max_mps),
            _degrees(HARDEST_RADPS2), _milli(HARDEST_MPS2), 500,
        )
        + _text(name)
        + struct.pack("<BBB", 100, host_baud, 0)
        + struct.pack("<HHB", 0, bool(spec.sonars), rear_sonar)
        # Low battery in dV, ticks per turn of a wheel, watchdog in ms.
        + struct.pack("<HHH", 110, _TICKS_PER_TURN, _milli(watchdog_s))
        + struct.pack("<B", 0)
        + struct.pack("<HHHH", 250, round(STALL_WAIT_S / 0.005), 1000, 100)
        + struct.pack("<HH", _degrees(limits.turn_rate), _milli(limits.speed))
        + struct.pack("<HH", _degrees(limits.turn_acceleration), _degrees(limits.turn_deceleration))
        + struct.pack("<HHH", 30, 60, 0)
        + struct.pack("<HH", _milli(limits.acceleration), _milli(limits.deceleration))
        + struct.pack("<HHH", 30, 60, 0)
        + bytes([bumpers, bumpers, 0, 40, 0, 0])
    )  # fmt: skip


def _text(word: str) -> bytes:
    return word.encode() + b"\0"


def _degrees(radians: float) -> int:
    return round(math.degrees(radians))


def _milli(value: float) -> int:
    return round(value * 1000)


def _clamped16(value: float) -> int:
    """Return the nearest int16."""
    return max(-0x8000, min(0x7FFF, round(value)))
