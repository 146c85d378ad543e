"""A drive process with emulated robots, and a client that talks to it as the web process does."""

from __future__ import annotations

import contextlib
import math
import os
import random
import socket
import subprocess
import sys
import threading
import time
from typing import Any

import pytest

from app.contract.drive import (
    ArmRobot,
    ConnectRobot,
    DriveCommand,
    DriveState,
    LeaveDrive,
    SetGuard,
    StoppedEvent,
    TakeLease,
)
from app.contract.values import plain
from app.drive.driven_role import RELEASE_FIRST
from app.drive.supervisor import DRIVE_COMMAND
from app.runtime.arguments import ProcessArguments
from app.runtime.environment import program_environment
from app.runtime.latest import LatestWriter
from app.runtime.pipe import encode, load_message
from app.runtime.requests import Reply, Request
from observer.guard.sight import FreeScan, Sight
from observer.simulation.robots.emulated import EmulatedRobot
from observer.simulation.robots.serving import Serving
from observer.types import Status

from ...waiting import until

PROMISED_S = 0.300
PATIENCE_S = 15.0
SPEED_MPS = 0.3
MODELS = {"observer": "amigo-sh", "obstacle": "p3dx-sh"}
Robots = dict[str, Serving[EmulatedRobot]]


class Eyes:
    """Writes a clear view into the slot, 30 times a second, as the engine does."""

    def __init__(self, slot: int) -> None:
        self._writer = LatestWriter(slot)
        self._ended = threading.Event()
        self.open = True
        self.last = 0.0
        # Metres: distance to an obstacle ahead; None: clear.
        self.blocked_m: float | None = None
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        frame = 0
        while not self._ended.wait(1 / 30):
            if self.open:
                frame += 1
                self.last = time.monotonic()
                self._writer.write(sight_to(self.blocked_m, frame, self.last).facts())

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self._writer.close()


def sight_to(blocked_m: float | None, frame: int, now: float) -> Sight:
    bearings = tuple(math.radians(3 * number - 60) for number in range(41))
    count = len(bearings)
    # Straight ahead only.
    blocked = tuple(blocked_m if abs(bearing) < 0.15 else None for bearing in bearings)
    known_to = tuple(20.0 if each is None else each for each in blocked)
    scan = FreeScan(bearings, blocked, (0.0,) * count, known_to)
    return Sight(frame, now, now, "real", Status.OK, (), True, (), scan)


class Drive:
    """A drive process, and the requests of a web process to it."""

    def __init__(self, slots: dict[str, int]) -> None:
        self.sock, there = socket.socketpair()
        with there:
            arguments = ProcessArguments(there.fileno(), os.getpid(), slots)
            self.process = subprocess.Popen(
                [*DRIVE_COMMAND, *arguments.as_command_line()],
                pass_fds=[there.fileno(), *slots.values()],
                env=program_environment(),
                start_new_session=True,
            )
        self.facts: dict[str, Any] = {}
        self.stops: list[StoppedEvent] = []
        self._replies: dict[int, Reply] = {}
        self._number = 0
        self._sequence = 0
        self.leases: dict[str, str] = {}
        self._hearing = threading.Thread(target=self._hear)
        self._hearing.start()
        until(lambda: self.facts, "the first event")

    def _hear(self) -> None:
        stream = self.sock.makefile("rb")
        while (message := load_message(stream)) is not None:
            if isinstance(message, Reply):
                self._replies[message.number] = message
            elif isinstance(message, DriveState):
                self.facts = plain(message.facts)
            elif isinstance(message, StoppedEvent):
                self.stops.append(message)

    def ask(self, command: Any) -> Reply:
        self._number += 1
        self.sock.sendall(encode(Request(self._number, command)))
        number = self._number
        reply: Reply = until(lambda: self._replies.pop(number, None), type(command).__name__)
        return reply

    def value(self, command: Any) -> Any:
        reply = self.ask(command)
        assert reply.refusal is None, reply.error
        return reply.value

    def state(self, role: str) -> str | None:
        robot = self.facts["robots"][role]
        return None if robot is None else robot["state"]

    def connect(self, robots: Robots) -> None:
        for role, robot in robots.items():
            self.value(ConnectRobot(role, robot.port, None, "real"))  # type: ignore[arg-type]
        until(lambda: all(self.state(role) == "disarmed" for role in robots), "the robots")
        # The sooner robots reach their speed, the more trials fit into a test.
        self.value(SetGuard({"guard.acceleration_mps2": 3.0}))

    def arm(self, role: str) -> None:
        self.leases[role] = self.value(TakeLease(role, "Ann", takeover=True))  # type: ignore[arg-type]
        reply = None
        # The robot may have to come to rest first.
        for _ in range(100):
            reply = self.ask(ArmRobot(role, self.leases[role]))  # type: ignore[arg-type]
            if reply.refusal is None:
                return
            time.sleep(0.02)
        raise AssertionError(reply)

    def command(self, role: str, speed: float) -> tuple[float, Any]:
        """Send a command; return when it was issued, and the answer."""
        self._sequence += 1
        issued = time.monotonic()
        command = DriveCommand(role, self.leases[role], self._sequence, issued, speed, 0.0)  # type: ignore[arg-type]
        return issued, self.value(command)

    def speed_up(self, roles: Any, hold_s: float = 0.2) -> float:
        """Drive until all are at speed; return when the last command was issued."""
        issued, started = 0.0, time.monotonic()
        deadline = started + PATIENCE_S
        while time.monotonic() < started + hold_s:
            assert time.monotonic() < deadline, self.facts
            for role in roles:
                issued, answer = self.command(role, SPEED_MPS)
                if answer.speed_mps < SPEED_MPS - 0.01:
                    started = time.monotonic()
                if RELEASE_FIRST in (answer.limited_by or ""):
                    # This process stalled for too long: the key has to be let go first.
                    self.command(role, 0.0)
            time.sleep(random.uniform(0.05, 0.1))
        return issued

    def hold(self, role: str, seconds: float) -> bool:
        """Drive on; return whether this process was never late, so that the speed had to hold."""
        started = before = time.monotonic()
        while time.monotonic() < started + seconds:
            issued, answer = self.command(role, SPEED_MPS)
            if issued - before > 0.2:
                self.speed_up([role])
                return False
            assert answer.speed_mps == pytest.approx(SPEED_MPS)
            before = issued
            time.sleep(0.05)
        return True

    def close(self) -> None:
        if self.process.poll() is None:
            with contextlib.suppress(OSError):
                self.sock.sendall(encode(Request(0, LeaveDrive())))
            try:
                self.process.wait(6)
            finally:
                self.process.kill()
                self.process.wait()
        with contextlib.suppress(OSError):
            self.sock.shutdown(socket.SHUT_RDWR)
        self._hearing.join()
        self.sock.close()


def zero_after(robot: Serving[EmulatedRobot], moment: float) -> float:
    """Return the seconds from a moment to the first packet after which the robot stays stopped."""
    first = until(lambda: robot.robot.log.first_standing(moment), "zero", 3.0)
    assert not robot.robot.log.unintended
    return float(first.time - moment)


def stays_at_rest(robots: Robots, moment: float) -> None:
    """Assert that after the first zero only zeros were commanded."""
    for robot in robots.values():
        behind = robot.robot.log.since(moment)
        start = next(number for number, each in enumerate(behind) if each.is_standstill)
        assert all(each.is_standstill for each in behind[start:]), "it was set in motion again"


def report(what: str, worst: float) -> None:
    sys.stdout.write(f"\n{what}: zero after {1000 * worst:.0f} ms at most\n")
