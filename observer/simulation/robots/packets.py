"""Data of the packets that a robot sends; their framing is ``observer.robots.arcos``.

Layouts as in MobileRobots' manuals of ARCOS and AmigOS. Written independently of the driver's
decoder, so that a mistake in either shows.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass

STATUS_STANDS, STATUS_MOVES = 0x32, 0x33
CONFIG_REPLY, ENCODER_REPLY, IO_REPLY = 0x20, 0x90, 0xF0
STRANGE = (0x98, 0xB0, 0xB8)


def clamped16(value: float) -> int:
    """Return the nearest int16."""
    return max(-0x8000, min(0x7FFF, round(value)))


@dataclass(frozen=True)
class StatusFields:
    """A standard status packet, in the packet's own units.

    Attributes:
        stall: bit 0 left wheel, 8 right wheel, 1-7 rear and 9-15 front bumpers.
        sonars: new ranges in mm by index.
    """

    moving: bool
    x: int
    y: int
    heading: int
    left: int
    right: int
    battery_dv: int
    stall: int
    flags: int
    sonars: Mapping[int, int]
    charge_state: int
    turn_rate: int
    temperature: int
    state_of_charge: int

    def data(self, *, short: bool, overrun: bool) -> bytes:
        """Return the packet's data.

        Args:
            short: end after digital out. overrun: claim sonar readings that do not fit.
        """
        readings = list(self.sonars.items())
        fixed = struct.pack(
            "<BHHhhhBHhHBB",
            STATUS_MOVES if self.moving else STATUS_STANDS,
            self.x & 0x7FFF, self.y & 0x7FFF, self.heading, self.left, self.right,
            min(255, self.battery_dv), self.stall & 0xFFFF, 0, self.flags & 0xFFFF, 0,
            255 if overrun else len(readings),
        )  # fmt: skip
        sonar = b"".join(struct.pack("<BH", index, value) for index, value in readings)
        # Gripper, analog port and its value, digital in and out.
        ports = bytes(5)
        if short:
            return fixed + sonar + ports
        # Fault flags, lateral velocity; the battery once more, in the same unit but wider.
        more = struct.pack(
            "<HBhHhbB", self.battery_dv, self.charge_state, self.turn_rate, 0, 0,
            self.temperature, self.state_of_charge,
        )  # fmt: skip
        return fixed + sonar + ports + more


@dataclass(frozen=True)
class ConfigFields:
    """A robot's settings; speeds in mm/s and deg/s, accelerations per second."""

    subtype: str
    name: str
    serial: str
    rot_top: int
    trans_top: int
    rot_acc_top: int
    trans_acc_top: int
    host_baud: int
    front_sonar: bool
    rear_sonar: bool
    low_battery_dv: int
    ticks_per_turn: int
    watchdog_ms: int
    stall_count: int
    rot_max: int
    trans_max: int
    rot_acc: int
    rot_dec: int
    trans_acc: int
    trans_dec: int
    front_bumpers: int
    rear_bumpers: int

    def data(self) -> bytes:
        """Return the packet's data, every field that the manuals name."""
        words = (f"{text}".encode() + b"\0" for text in ("Pioneer", self.subtype, self.serial))
        return (
            bytes([CONFIG_REPLY])
            + b"".join(words)
            + struct.pack(
                "<BHHHHH", 0, self.rot_top, self.trans_top, self.rot_acc_top,
                self.trans_acc_top, 500,
            )
            + self.name.encode() + b"\0"
            + struct.pack("<BBB", 100, self.host_baud, 0)
            + struct.pack("<HHB", 0, self.front_sonar, self.rear_sonar)
            + struct.pack("<HHH", self.low_battery_dv, self.ticks_per_turn, self.watchdog_ms)
            + struct.pack("<B", 0)
            + struct.pack("<HHHH", 250, self.stall_count, 1000, 100)
            + struct.pack("<HHHH", self.rot_max, self.trans_max, self.rot_acc, self.rot_dec)
            + struct.pack("<HHH", 30, 60, 0)
            + struct.pack("<HH", self.trans_acc, self.trans_dec)
            + struct.pack("<HHH", 30, 60, 0)
            + bytes([self.front_bumpers, self.rear_bumpers, 0, 40, 0, 0])
        )  # fmt: skip
