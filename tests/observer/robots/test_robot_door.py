"""Damaged input through an emulated robot's real ports: it survives, stays put, listens again."""

from __future__ import annotations

import os
import socket
import struct
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, suppress
from typing import Literal, TypeVar

import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.robots.arcos import Command, command, packet
from observer.simulation.robots.emulated import EmulatedRobot
from observer.simulation.robots.serving import Serving, serve_pty, serve_tcp

from ...damage import damaged, examples, hostile_bytes
from ...waiting import until
from . import fuzz

ENABLE, VEL = command(Command.ENABLE, 1), command(Command.VEL, 200)
STREAM = b"".join((VEL, command(Command.RVEL, -30), command(Command.CONFIG),
                   command(Command.SETO), packet(bytes(range(50, 90)))))  # fmt: skip
# A packet that announces more than arrives, one without data, and a flood of headers.
PIECES = (VEL, VEL[:-1], ENABLE, b"\xfa", b"\xfa\xfb", b"\xfa\xfb\xff", b"\xfa\xfb\0",
          b"\xfa\xfb\xff" * 300, b"\x03\x04\x11\x13\x1a\x1c")  # fmt: skip
# Seconds: longer than a packet may be interrupted for.
PAUSE_S = 0.2


class Door:
    """The client's end of a served robot, whose clock advances only when told to.

    Attributes:
        served: the robot's end.
    """

    def __init__(self, kind: Literal["tcp", "pty"]) -> None:
        self._now = 0.0
        self._tries = 0
        self._tcp = kind == "tcp"
        serve = serve_tcp if self._tcp else serve_pty
        self.served: Serving[EmulatedRobot] = serve(
            EmulatedRobot("p3dx-sh"), clock=lambda: self._now
        )
        self._line = ExitStack()
        self.connect()

    @property
    def robot(self) -> EmulatedRobot:
        return self.served.robot

    def connect(self) -> None:
        """Connect as soon as the robot accepts clients; it closes its port to a second one."""
        port = self.served.port
        if self._tcp:
            host, number = port.removeprefix("socket://").split(":")
            self._socket = until(lambda: _connected(host, int(number)))
            self._line.enter_context(closing(self._socket))
            self._write: Callable[[bytes], object] = self._socket.sendall
            until(lambda: self.served.connected)
            return
        fd = os.open(port, os.O_RDWR | os.O_NOCTTY)
        self._line.callback(os.close, fd)
        tty.setraw(fd)
        self._write = lambda data: os.write(fd, data)

    def vanish(self) -> None:
        """Disconnect without a goodbye, like a program killed with unread bytes."""
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self._line.close()
        until(lambda: not self.served.connected)

    def close(self) -> None:
        self._line.close()
        self.served.close()

    def say(self, data: bytes) -> None:
        """Write all of it; the robot reads it while its clock is stopped."""
        at = 0
        while at < len(data):
            # A pseudo terminal takes at most 4096 bytes at once.
            self._write(data[at : at + 1024])
            at += 1024

    def wait(self, seconds: float) -> None:
        """Let time pass, and return once the robot has caught up."""
        for _ in range(max(1, round(seconds / PAUSE_S))):
            self._now += PAUSE_S
            until(lambda: self.robot._moved >= self._now or not self.served._thread.is_alive())

    def understood(self) -> None:
        """Return once a command after everything sent has been obeyed."""
        self._tries += 1
        mark = (Command.SONAR, 0x4000 + self._tries % 0x2000)
        self.say(command(*mark))
        arrived = self.robot.log.since

        def marked() -> bool:
            assert self.served._thread.is_alive(), "the robot has ended"
            self.wait(PAUSE_S)
            return any((each.number, each.argument) == mark for each in arrived()[-20:])

        until(marked)

    def open(self) -> None:
        """Have a session with the motors on and the wheels standing."""
        if not self.robot.is_open:
            self.say(fuzz.OPENING)
        self.say(command(Command.ENABLE, 0) + ENABLE)
        self.understood()
        until(self.wheels_stand)

    def wheels_stand(self) -> bool:
        self.wait(PAUSE_S)
        return self.robot.speed_mps == 0.0


Value = TypeVar("Value")


def _connected(host: str, port: int) -> socket.socket | None:
    with suppress(ConnectionRefusedError):
        connection = socket.create_connection((host, port), 5)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return connection
    return None


@pytest.fixture(scope="module", params=["tcp", "pty"])
def door(request: pytest.FixtureRequest) -> Iterator[Door]:
    with closing(Door(request.param)) as door:
        yield door


@examples(8)
@given(
    content=damaged([STREAM], PIECES) | hostile_bytes((STREAM, *PIECES)),
    sizes=st.lists(st.integers(1, 300), min_size=1, max_size=5),
)
def test_garbage_neither_ends_the_robot_nor_moves_it(
    door: Door, content: bytes, sizes: list[int]
) -> None:
    door.open()
    before = door.robot.odometry
    at = turn = 0
    while at < len(content):
        size = sizes[turn % len(sizes)]
        door.say(content[at : at + size])
        at, turn = at + size, turn + 1
    door.understood()
    # SETO sets the odometry to zero, whatever it was before.
    asked = fuzz.numbers_in(content) & {*fuzz.MOTIONS, Command.SETO}
    assert asked or door.robot.odometry == before
    # Valid commands are obeyed again.
    door.open()
    before = door.robot.odometry
    door.say(VEL)
    door.understood()
    door.wait(2 * PAUSE_S)
    assert door.robot.odometry != before


@pytest.mark.parametrize("paused", [False, True])
def test_a_split_command_is_obeyed_unless_the_pause_is_too_long(door: Door, paused: bool) -> None:
    for at in range(1, len(VEL)):
        door.open()
        before = door.robot.odometry
        door.say(VEL[:at])
        until(lambda: not paused or _gone_by(door))
        door.say(VEL[at:])
        door.understood()
        door.wait(PAUSE_S)
        assert (door.robot.odometry == before) is paused, at


def _gone_by(door: Door) -> bool:
    """Wait until everything sent has been read and is too old to be continued."""
    time.sleep(0.02)
    door.wait(3 * PAUSE_S)
    return True


def test_a_partial_command_is_not_completed_by_the_next_client() -> None:
    with closing(Door("tcp")) as door:
        for at in range(1, len(VEL)):
            door.open()
            before = door.robot.odometry
            door.say(VEL[:at])
            door.vanish()
            door.connect()
            door.say(VEL[at:])
            door.understood()
            assert door.robot.odometry == before, at


def test_a_flood_ends_and_the_next_command_is_obeyed(door: Door) -> None:
    door.open()
    before = door.robot.odometry
    door.say(b"\xfa\xfb\xff\xfa\xfb\x03\xff" * 4000)
    door.understood()
    assert door.robot.odometry == before
