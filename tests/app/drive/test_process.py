"""The real drive process before emulated robots: how soon the first zero is on their ports.

Each test prints its worst value. DRIVE_TRIALS sets how often each fault is tried.
"""

from __future__ import annotations

import contextlib
import math
import os
import random
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.channel.latest import LatestReader, LatestWriter, create_slot
from app.channel.pipe import encode, receive_message
from app.drive.messages import (
    SIGHT_NAME,
    WHEELS_NAME,
    ArmRobot,
    ConnectRobot,
    DisarmRobot,
    DisconnectRobot,
    DriveCommand,
    DriveEvent,
    LeaveDrive,
    ReleaseLease,
    ResetStop,
    SetGuard,
    StoppedEvent,
    StopRobots,
    TakeLease,
)
from app.drive.supervisor import DRIVE_COMMAND
from app.messages import Reply, Request
from app.native_environment import program_environment
from app.processes.arguments import ProcessArguments
from observer.guard.sight import FreeScan, Sight
from observer.simulation.robots.emulated import EmulatedRobot
from observer.simulation.robots.serving import Serving, serve_tcp
from observer.types import Status

HERE = Path(__file__).parent
TRIALS = int(os.environ.get("DRIVE_TRIALS", "2"))
PROMISED_S = 0.300
PATIENCE_S = 15.0
SPEED_MPS = 0.3
MODELS = {"observer": "amigo-sh", "obstacle": "p3dx-sh"}
Robots = dict[str, Serving[EmulatedRobot]]


def until(found: Callable[[], Any], what: str, patience_s: float = PATIENCE_S) -> Any:
    deadline = time.monotonic() + patience_s
    while not (result := found()):
        assert time.monotonic() < deadline, f"{what} did not come"
        time.sleep(0.005)
    return result


class Eyes:
    """Writes a clear sight into the slot, 30 times a second, as the engine does."""

    def __init__(self, slot: int) -> None:
        self._writer = LatestWriter(slot)
        self._ended = threading.Event()
        self.open = True
        self.last = 0.0
        # How far ahead something stands.
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
    # Straight ahead alone.
    blocked = tuple(blocked_m if abs(bearing) < 0.15 else None for bearing in bearings)
    known_to = tuple(20.0 if each is None else each for each in blocked)
    scan = FreeScan(bearings, blocked, (0.0,) * count, known_to)
    return Sight(frame, now, now, "real", Status.OK, (), True, (), scan)


class Drive:
    """A drive process and what a web process says to it."""

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
        while (message := receive_message(self.sock)) is not None:
            if isinstance(message, Reply):
                self._replies[message.number] = message
            elif isinstance(message, DriveEvent):
                self.facts = message.facts
            elif isinstance(message, StoppedEvent):
                self.stops.append(message)

    def ask(self, command: Any) -> Reply:
        self._number += 1
        self.sock.sendall(encode(Request(self._number, command)))
        number = self._number
        reply: Reply = until(lambda: self._replies.pop(number, None), type(command).__name__)
        return reply

    def value(self, command: Any) -> dict[str, Any]:
        reply = self.ask(command)
        assert reply.refusal is None, reply.error
        return reply.value or {}

    def state(self, role: str) -> str | None:
        robot = self.facts["robots"][role]
        return None if robot is None else robot["state"]

    def connect(self, robots: Robots) -> None:
        for role, robot in robots.items():
            self.value(ConnectRobot(role, robot.port, None, "real"))  # type: ignore[arg-type]
        until(lambda: all(self.state(role) == "disarmed" for role in robots), "the robots")
        # Who has come to speed sooner can be stopped more often.
        self.value(SetGuard({"guard.acceleration_mps2": 3.0}))

    def arm(self, role: str) -> None:
        self.leases[role] = self.value(TakeLease(role, "Ann", takeover=True))["lease"]  # type: ignore[arg-type]
        reply = None
        # A robot may have to come to rest before.
        for _ in range(100):
            reply = self.ask(ArmRobot(role, self.leases[role]))  # type: ignore[arg-type]
            if reply.refusal is None:
                return
            time.sleep(0.02)
        raise AssertionError(reply)

    def command(self, role: str, speed: float) -> tuple[float, dict[str, Any]]:
        """When it was given, and the answer."""
        self._sequence += 1
        issued = time.monotonic()
        command = DriveCommand(role, self.leases[role], self._sequence, issued, speed, 0.0)  # type: ignore[arg-type]
        return issued, self.value(command)

    def speed_up(self, roles: Any, hold_s: float = 0.2) -> float:
        """Drive until all are at speed; when the last command was given."""
        issued, begun = 0.0, time.monotonic()
        deadline = begun + PATIENCE_S
        while time.monotonic() < begun + hold_s:
            assert time.monotonic() < deadline, self.facts
            for role in roles:
                issued, answer = self.command(role, SPEED_MPS)
                if answer["speed_mps"] < SPEED_MPS - 0.01:
                    begun = time.monotonic()
                if "let go" in (answer["limited_by"] or ""):
                    # This process stood still for too long.
                    self.command(role, 0.0)
            time.sleep(random.uniform(0.05, 0.1))
        return issued

    def hold(self, role: str, seconds: float) -> bool:
        """Drive on; whether this process gave every command in time, so that it had to work."""
        begun = before = time.monotonic()
        while time.monotonic() < begun + seconds:
            issued, answer = self.command(role, SPEED_MPS)
            if issued - before > 0.2:
                self.speed_up([role])
                return False
            assert answer["speed_mps"] == pytest.approx(SPEED_MPS)
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


@pytest.fixture
def slots() -> Iterator[dict[str, int]]:
    slots = {name: create_slot(256 * 1024) for name in (SIGHT_NAME, WHEELS_NAME)}
    yield slots
    for fd in slots.values():
        os.close(fd)


@pytest.fixture
def eyes(slots: dict[str, int]) -> Iterator[Eyes]:
    eyes = Eyes(slots[SIGHT_NAME])
    yield eyes
    eyes.close()


@pytest.fixture
def robots() -> Iterator[Robots]:
    with contextlib.ExitStack() as stack:
        yield {
            role: stack.enter_context(serve_tcp(EmulatedRobot(model, now=time.monotonic())))
            for role, model in MODELS.items()
        }


@pytest.fixture
def drive(slots: dict[str, int], eyes: Eyes) -> Iterator[Drive]:
    del eyes
    drive = Drive(slots)
    yield drive
    drive.close()


def zero_after(robot: Serving[EmulatedRobot], moment: float) -> float:
    """Seconds from a moment to the first packet behind which the robot stands for good."""
    first = until(lambda: robot.robot.log.first_standing(moment), "zero", 3.0)
    assert not robot.robot.log.unintended
    return float(first.time - moment)


def stays_at_rest(robots: Robots, moment: float) -> None:
    """Behind the first zero nothing but standing was commanded."""
    for robot in robots.values():
        behind = robot.robot.log.since(moment)
        start = next(number for number, each in enumerate(behind) if each.stands)
        assert all(each.stands for each in behind[start:]), "it was set in motion again"


def report(what: str, worst: float) -> None:
    sys.stdout.write(f"\n{what}: zero after {1000 * worst:.0f} ms at most\n")


# --- while the process lives --------------------------------------------------------------------


def test_expiry_lost_leases_stop_and_lost_sight_are_zero_in_time(
    drive: Drive, robots: Robots, eyes: Eyes
) -> None:
    drive.connect(robots)
    worst = dict.fromkeys(("expiry", "lease", "stop", "sight"), 0.0)
    for _ in range(TRIALS):
        for what in worst:
            for role in robots:
                drive.arm(role)
            moment = drive.speed_up(robots)
            standing = ["observer", "obstacle"]
            if what != "expiry":
                moment = time.monotonic()
            if what == "lease":
                for role in robots:
                    drive.value(ReleaseLease(role, drive.leases[role]))  # type: ignore[arg-type]
            elif what == "stop":
                drive.value(StopRobots("a test"))
            elif what == "sight":
                eyes.open, standing = False, ["observer"]
                time.sleep(0.04)
                moment = eyes.last
                while time.monotonic() < moment + 0.4:
                    drive.command("observer", SPEED_MPS)
                    drive.command("obstacle", SPEED_MPS)
                    time.sleep(0.02)
                eyes.open = True
            for role in standing:
                worst[what] = max(worst[what], zero_after(robots[role], moment))
            if what == "stop":
                drive.value(ResetStop("a test"))
            for role in robots:
                drive.value(DisarmRobot(role))  # type: ignore[arg-type]
    for what, value in worst.items():
        report(what, value)
        assert value <= PROMISED_S
    assert worst["expiry"] >= 0.22, "a command must count for its time"
    facts = drive.facts["loop"]
    sys.stdout.write(f"loop: {facts}\n")


def test_one_ports_trouble_never_delays_the_other(
    drive: Drive, robots: Robots, slots: dict[str, int]
) -> None:
    drive.connect(robots)
    for role in robots:
        drive.arm(role)
    drive.speed_up(robots)
    # Its socket is read no more, and it says nothing: it hangs.
    robots["observer"].robot.faults.deaf = robots["observer"].robot.faults.silent = True

    def drives_on() -> None:
        begun = time.monotonic()
        if drive.hold("obstacle", 2.0):
            assert all(not each.stands for each in robots["obstacle"].robot.log.since(begun))

    drives_on()
    assert drive.state("observer") != "moving"
    # Nobody accepts at this port, and nobody answers.
    with socket.create_server(("127.0.0.1", 0), backlog=1) as hanging:
        port = f"socket://127.0.0.1:{hanging.getsockname()[1]}"
        drive.value(ConnectRobot("observer", port, None, "real"))
        drives_on()
        drive.value(DisconnectRobot("observer"))
    reader = LatestReader(slots[WHEELS_NAME])
    latest = reader.read()
    reader.close()
    assert latest is not None
    assert len(latest.header["obstacle"]) >= 5
    assert latest.header["observer"] == []
    sys.stdout.write(f"\nloop: {drive.facts['loop']}\n")


class Path:
    """Where a robot truly was, for as long as it is followed."""

    def __init__(self, robot: EmulatedRobot) -> None:
        self._robot = robot
        self._ended = threading.Event()
        self._was: list[tuple[float, float]] = []
        self._thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        while not self._ended.wait(0.004):
            self._was.append((time.monotonic(), self._robot.vehicle.state.x))

    def __enter__(self) -> Path:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def way(self, start: float, end: float) -> float:
        """Between two moments."""
        times, places = zip(*self._was, strict=True)
        return float(abs(np.interp(end, times, places) - np.interp(start, times, places)))


def test_each_stop_is_measured_as_it_really_was(drive: Drive, robots: Robots, eyes: Eyes) -> None:
    drive.connect(robots)
    for kind, role in (("expired", "obstacle"), ("sight", "observer"), ("guard", "observer")):
        robot = robots[role]
        drive.arm(role)
        with Path(robot.robot) as path:
            cause = drive.speed_up([role], 0.4)
            drive.stops.clear()
            if kind == "sight":
                eyes.open = False
                cause = eyes.last
            elif kind == "guard":
                eyes.blocked_m, cause = 0.25, time.monotonic()
            while kind != "expired" and not drive.stops and time.monotonic() < cause + 3:
                drive.command(role, SPEED_MPS)
                time.sleep(0.02)
            stop = until(lambda: drive.stops and drive.stops[0], f"the stop by {kind}", 6)
        eyes.open, eyes.blocked_m = True, None
        assert (stop.role, stop.kind) == (role, kind)
        assert stop.zero_time is not None
        assert stop.stood_time is not None
        # A frame of the engine's may still have been under way; a verdict comes by the next one.
        assert -0.01 <= stop.cause_time - cause <= (0.25 if kind == "guard" else 0.05)
        first = robot.robot.log.first_standing(cause)
        assert first is not None
        # To the port and back: a busy machine may look at either end late.
        assert first.time == pytest.approx(stop.zero_time, abs=0.1)
        took, stood = stop.zero_time - stop.cause_time, stop.stood_time - stop.cause_time
        way = path.way(stop.cause_time, stop.stood_time)
        sys.stdout.write(
            f"\n{kind}: zero after {1000 * took:.0f} ms, stood after {1000 * stood:.0f} ms, "
            f"{stop.distance_m:.3f} m of {way:.3f} m\n"
        )
        assert took <= PROMISED_S
        assert stop.speed_mps == pytest.approx(SPEED_MPS, abs=0.03)
        assert stop.distance_m == pytest.approx(way, abs=0.03)
        length = drive.facts["robots"][role]["report"]["length_m"]
        left = pytest.approx(0.25 - length / 2, abs=0.003) if kind == "guard" else None
        assert stop.separation_m == left
        drive.value(DisarmRobot(role))  # type: ignore[arg-type]


# --- while it is ended --------------------------------------------------------------------------


def shut_channel(drive: Drive) -> None:
    drive.sock.shutdown(socket.SHUT_RDWR)


def terminate(drive: Drive) -> None:
    drive.process.terminate()


@pytest.mark.parametrize("end", [shut_channel, terminate])
def test_however_it_is_ended_the_robots_are_stopped_first(
    end: Callable[[Drive], None], robots: Robots, slots: dict[str, int], eyes: Eyes
) -> None:
    del eyes
    worst = 0.0
    for _ in range(1 + TRIALS // 4):
        drive = Drive(slots)
        try:
            drive.connect(robots)
            for role in robots:
                drive.arm(role)
            drive.speed_up(robots)
            moment = time.monotonic()
            end(drive)
            worst = max(worst, *(zero_after(robot, moment) for robot in robots.values()))
            assert drive.process.wait(5) == 0
            stays_at_rest(robots, moment)
            assert not any(robot.robot.firmware.is_open for robot in robots.values()), "no goodbye"
        finally:
            drive.close()
    report(end.__name__, worst)
    assert worst <= PROMISED_S


def test_killed_it_leaves_the_robot_to_its_watchdog(robots: Robots, drive: Drive) -> None:
    drive.connect(robots)
    for role in robots:
        drive.arm(role)
    drive.speed_up(robots)
    watchdog = drive.facts["robots"]["obstacle"]["report"]["watchdog_s"]
    assert watchdog == 2.0
    drive.process.kill()
    moment = time.monotonic()
    until(lambda: all(abs(r.robot.speed_mps) < 0.01 for r in robots.values()), "rest", 5)
    took = time.monotonic() - moment
    sys.stdout.write(f"\nkill -9 of the drive process: at rest after {took:.1f} s\n")
    assert watchdog - 0.3 <= took <= watchdog + 1.5


# --- while its parent is ended or hangs ---------------------------------------------------------


class Parent:
    """``driving_parent.py``, and when it gave its commands."""

    def __init__(self, slots: dict[str, int], robots: Robots) -> None:
        words = [f"{role}={robot.port}" for role, robot in robots.items()]
        fds = [slots[SIGHT_NAME], slots[WHEELS_NAME]]
        self.process = subprocess.Popen(
            [sys.executable, str(HERE / "driving_parent.py"), *map(str, fds), *words],
            stdout=subprocess.PIPE,
            pass_fds=fds,
            env=program_environment(),
        )
        assert self.process.stdout is not None
        os.set_blocking(self.process.stdout.fileno(), False)
        self._text = b""
        until(self.last_command, "the parent's driving", 30)

    def last_command(self) -> float | None:
        """When the newest command was given."""
        assert self.process.stdout is not None
        with contextlib.suppress(BlockingIOError):
            self._text += os.read(self.process.stdout.fileno(), 65536)
        lines = self._text.split(b"\n")[:-1]
        return float(lines[-1]) if lines else None

    def close(self) -> None:
        self.process.send_signal(signal.SIGCONT)
        self.process.kill()
        self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_parent_that_dies_or_hangs_moves_nothing_any_more(
    number: signal.Signals, robots: Robots, slots: dict[str, int], eyes: Eyes
) -> None:
    del eyes
    worst = 0.0
    for _ in range(1 + TRIALS // 4):
        parent = Parent(slots, robots)
        try:
            time.sleep(random.uniform(0.0, 0.1))
            parent.process.send_signal(number)
            sent = time.monotonic()
            time.sleep(0.01)
            # The zero may not come before the fault: nothing else stops here.
            moment = parent.last_command() or sent
            for robot in robots.values():
                first = zero_after(robot, sent)
                worst = max(worst, first + sent - moment if number == signal.SIGSTOP else first)
            if number == signal.SIGSTOP:
                time.sleep(0.5)
                parent.process.send_signal(signal.SIGCONT)
                time.sleep(0.5)
            stays_at_rest(robots, sent)
        finally:
            parent.close()
        # The drive process says goodbye and is gone, whatever became of its parent.
        until(lambda: not any(r.robot.firmware.is_open for r in robots.values()), "goodbye", 5)
    report(number.name, worst)
    assert worst <= PROMISED_S
