"""A square of 10 m, driven by an emulated robot, as reported in its status packets."""

from __future__ import annotations

import math
import sys

import pytest

from observer.robots.arcos import Command, PacketParser, command
from observer.robots.models import robot_spec
from observer.robots.odometry import WheelOdometry
from observer.robots.sip import decode_status, is_status
from observer.simulation.robots.emulated import EmulatedRobot

TICK_S = 0.01


class Square:
    """Drives on a simulated clock, and tracks how far odometry is from the emulator's truth.

    Attributes:
        worst_m, worst_rad: largest errors so far. wraps: how often X or Y wrapped.
    """

    def __init__(self, model: str) -> None:
        self.robot = EmulatedRobot(model)
        self.spec = robot_spec(model)
        self.odometry = WheelOdometry(self.spec)
        self.parser = PacketParser()
        self.now = 0.0
        self.worst_m = self.worst_rad = 0.0
        self.wraps = 0
        self._raw: tuple[int, int] | None = None
        self.robot.begin_session(0.0)
        self.tell(command(Command.ENABLE, 1), command(Command.SETA, 1000))
        # Odometry starts with the first packet, before it moves.
        self._stand()

    def tell(self, *commands: bytes) -> None:
        for each in commands:
            self.robot.receive(each, self.now)

    def tick(self) -> tuple[float, float, float]:
        """Advance one step and return the true pose."""
        self.now += TICK_S
        sent = self.robot.tick(self.now)
        truth = self.robot.odometry
        for payload in filter(is_status, self.parser.feed(sent)):
            status = decode_status(payload, self.spec)
            raw = status.raw_x, status.raw_y
            before, self._raw = self._raw, raw
            if before is not None:
                self.wraps += sum(abs(a - b) > 0x4000 for a, b in zip(raw, before, strict=True))
            place = self.odometry.add(*raw, status.raw_heading, self.now)
            self.worst_m = max(self.worst_m, math.dist((place.x, place.y), truth[:2]))
            self.worst_rad = max(self.worst_rad, abs(place.yaw - truth[2]))
            self.tell(command(Command.PULSE))
        return truth

    def forward(self, metres: float) -> None:
        start = self.tick()
        self.tell(command(Command.VEL, 600))
        while math.dist(self.tick()[:2], start[:2]) < metres - 0.25:
            pass
        self._stand()

    def turn(self, radians: float) -> None:
        start = self.tick()[2]
        self.tell(command(Command.RVEL, 40 if radians > 0 else -40))
        while abs(self.tick()[2] - start) < abs(radians) - 0.15:
            pass
        self._stand()

    def _stand(self) -> None:
        self.tell(command(Command.VEL, 0), command(Command.RVEL, 0))
        for _ in range(150):
            self.tick()


@pytest.mark.parametrize(
    ("model", "corner"),
    [("p3dx-sh", math.pi / 2), ("amigo", -math.pi / 2)],
)
def test_odometry_is_within_a_millimetre_of_the_emulators_truth(model: str, corner: float) -> None:
    square = Square(model)
    for _ in range(4):
        square.forward(10.0)
        square.turn(corner)
    sys.stdout.write(
        f"{model}: worst {square.worst_m * 1000:.3f} mm, {math.degrees(square.worst_rad):.3f} deg, "
        f"{square.wraps} wraps\n"
    )
    assert square.odometry.jumps == 0
    assert square.wraps >= 1
    assert square.worst_m <= 0.001
    assert square.worst_rad <= 0.002
