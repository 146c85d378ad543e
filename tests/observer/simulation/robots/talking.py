"""A client that talks to an emulated robot in bytes and controls its clock."""

from __future__ import annotations

import struct

from observer.robots.arcos import Command, PacketParser, command
from observer.simulation.robots.emulated import EmulatedRobot

SYNC = [bytes.fromhex(text) for text in ("fafb03000000", "fafb03010001", "fafb03020002")]
ENABLE = bytes.fromhex("fafb06043b0100053b")
VEL_200 = bytes.fromhex("fafb060b3bc800d33b")
VEL_MINUS_200 = bytes.fromhex("fafb060b1bc800d31b")
E_STOP, STOP = bytes.fromhex("fafb03370037"), bytes.fromhex("fafb031d001d")
TICK_S = 0.01


class Talk:
    """A client that talks to a robot and controls the clock."""

    def __init__(self, robot: EmulatedRobot) -> None:
        self.robot = robot
        self.now = 0.0
        self.heard: list[bytes] = []
        self._parser = PacketParser()

    def say(self, *packets: bytes) -> list[bytes]:
        """Send packets and return the immediate answers."""
        return [one for each in packets for one in self._hear(self.robot.receive(each, self.now))]

    def wait(self, seconds: float) -> list[bytes]:
        """Let time pass and return what arrives meanwhile."""
        heard: list[bytes] = []
        for _ in range(round(seconds / TICK_S)):
            self.now += TICK_S
            heard += self._hear(self.robot.tick(self.now))
        return heard

    def hold(self, seconds: float, *packets: bytes) -> list[bytes]:
        """The same, repeating commands ten times a second."""
        heard: list[bytes] = []
        for _ in range(round(seconds * 10)):
            heard += self.say(*packets) + self.wait(0.1)
        return heard

    def _hear(self, data: bytes) -> list[bytes]:
        found = self._parser.feed(data)
        self.heard += found
        return found


def opened(model: str = "p3dx-sh", **more: object) -> Talk:
    talk = Talk(EmulatedRobot(model, **more))  # type: ignore[arg-type]
    talk.say(*SYNC, command(Command.OPEN))
    return talk


def driving(model: str = "p3dx-sh", **more: object) -> Talk:
    talk = opened(model, **more)
    talk.say(ENABLE)
    talk.hold(2, VEL_200)
    return talk


def status(packet: bytes) -> dict[str, int]:
    """Decode by the table of offsets; fields after the sonar readings only if present."""
    assert packet[0] in (0x32, 0x33)
    names = ("x", "y", "th", "left", "right", "battery", "stall", "control", "flags", "compass")
    values = dict(zip(names, struct.unpack_from("<HHhhhBHhHB", packet, 1), strict=True))
    values["sonars"] = packet[19]
    at = 20 + 3 * packet[19]
    if len(packet) > at + 5:
        further = ("battery_x10", "charge", "turn_rate", "faults", "lateral", "celsius", "percent")
        rest = struct.unpack_from("<HBhHhbB", packet, at + 5)
        values |= dict(zip(further, rest, strict=True))
        assert len(packet) == at + 16
    else:
        assert len(packet) == at + 5
    return values


def newest(packets: list[bytes]) -> dict[str, int]:
    return status([each for each in packets if each[0] in (0x32, 0x33)][-1])
