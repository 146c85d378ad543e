"""Decoder of a robot's settings: the reply to CONFIG. Pure."""

from __future__ import annotations

import struct
from dataclasses import dataclass, fields
from typing import Any

CONFIG_REPLY = 0x20

# In reply order: name, and "s" for null-terminated text, "B" or "H" for a number.
_FIELDS: tuple[tuple[str, str], ...] = (
    ("type", "s"), ("subtype", "s"), ("serial", "s"), ("motors_4", "B"),
    ("turn_rate_top", "H"), ("speed_top", "H"), ("turn_acceleration_top", "H"),
    ("acceleration_top", "H"), ("pwm_max", "H"), ("name", "s"),
    ("sip_cycle", "B"), ("host_baud", "B"), ("aux1_baud", "B"),
    ("gripper", "H"), ("front_sonar", "H"), ("rear_sonar", "B"),
    ("low_battery", "H"), ("rev_count", "H"), ("watchdog_ms", "H"), ("p2mpacs", "B"),
    ("stall_value", "H"), ("stall_count", "H"), ("joy_speed", "H"), ("joy_turn_rate", "H"),
    ("turn_rate_max", "H"), ("speed_max", "H"), ("turn_acceleration", "H"),
    ("turn_deceleration", "H"), ("turn_kp", "H"), ("turn_kv", "H"), ("turn_ki", "H"),
    ("acceleration", "H"), ("deceleration", "H"), ("kp", "H"), ("kv", "H"), ("ki", "H"),
    ("front_bumpers", "B"), ("rear_bumpers", "B"), ("charger", "B"), ("sonar_cycle", "B"),
    ("autobaud", "B"), ("gyro", "B"),
)  # fmt: skip


@dataclass(frozen=True)
class ConfigReply:
    """Settings of a robot; None for what its reply leaves out.

    Attributes:
        type, subtype, name: its texts.
        turn_rate_top, turn_rate_max: deg/s, the highest accepted value, and the current setting.
        speed_top, speed_max: mm/s. acceleration_top: mm/s^2. turn_acceleration_top: deg/s^2.
        watchdog_ms: time without a command after which it stops its motors; 0: never.
        front_bumpers, rear_bumpers: how many segments are fitted. front_sonar, rear_sonar: whether
            the array is fitted; 0: not.
    """

    type: str | None = None
    subtype: str | None = None
    name: str | None = None
    turn_rate_top: int | None = None
    turn_rate_max: int | None = None
    speed_top: int | None = None
    speed_max: int | None = None
    acceleration_top: int | None = None
    turn_acceleration_top: int | None = None
    watchdog_ms: int | None = None
    front_sonar: int | None = None
    rear_sonar: int | None = None
    front_bumpers: int | None = None
    rear_bumpers: int | None = None


def decode_config(payload: bytes) -> ConfigReply:
    """Decode the reply's payload, type byte first; what is missing at its end is None.

    Raises:
        ValueError: it is not such a reply.
    """
    if not payload or payload[0] != CONFIG_REPLY:
        raise ValueError(
            f"a reply to CONFIG must start with 20, not {payload[:1].hex() or 'nothing'}"
        )
    found: dict[str, Any] = {}
    at = 1
    for name, kind in _FIELDS:
        if kind == "s":
            end = payload.find(b"\0", at)
            if end < 0:
                break
            found[name] = as_text(payload[at:end])
            at = end + 1
        else:
            size = struct.calcsize(kind)
            if at + size > len(payload):
                break
            (found[name],) = struct.unpack_from("<" + kind, payload, at)
            at += size
    return ConfigReply(**{each.name: found.get(each.name) for each in fields(ConfigReply)})


def as_text(data: bytes) -> str:
    """Return a text from a robot as printable ASCII; other characters become ``?``."""
    return "".join(chr(each) if 32 <= each < 127 else "?" for each in data).strip()
