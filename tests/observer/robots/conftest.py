"""Robots at the other end of a real port."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from typing import Any

import pytest

from observer.robots import handshake, pioneer
from observer.robots.contract import RobotPhase, RobotReport
from observer.robots.network.robot import ExternalRobot
from observer.robots.pioneer import Pioneer
from observer.simulation.robots.emulated import EmulatedRobot
from observer.simulation.robots.serving import Serving, serve_pty, serve_tcp

from ... import waiting
from .network.sides import Wire

DRIVE_S = 0.02


class Driven:
    """A driver and the emulated robot at the other end.

    Attributes:
        robot: the driver. serving: the emulator's end. there: the emulated robot.
    """

    def __init__(self, robot: Pioneer, serving: Serving[EmulatedRobot]) -> None:
        self.robot, self.serving, self.there = robot, serving, serving.robot

    def until(
        self, reached: Callable[[RobotReport], object], timeout_s: float = 8.0
    ) -> RobotReport:
        """Return the first report that satisfies the condition."""
        return wait_for_report(self.robot, reached, timeout_s)

    def connect(self) -> RobotReport:
        return self.until(lambda report: report.phase is RobotPhase.CONNECTED)

    def arm(self) -> None:
        self.connect()
        self.robot.enable()
        self.until(lambda report: report.motors_enabled)

    def drive(self, seconds: float, speed_mps: float = 0.3, turn_rate_radps: float = 0.0) -> None:
        """Send a velocity repeatedly, as a drive loop does."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self.robot.drive(speed_mps, turn_rate_radps)
            time.sleep(DRIVE_S)

    def drive_until(
        self, reached: Callable[[RobotReport], object], timeout_s: float = 5.0
    ) -> RobotReport:
        """Ask for 0.3 m/s until the condition holds."""
        until = time.monotonic() + timeout_s
        while time.monotonic() < until:
            self.robot.drive(0.3, 0.0)
            if reached(report := self.robot.report()):
                return report
            time.sleep(DRIVE_S)
        pytest.fail(f"it never came to that: {self.robot.report()}")

    def heard(self, since: float = float("-inf")) -> list[tuple[int, int | bytes | None]]:
        """Return numbers and arguments of the commands that arrived."""
        return [(each.number, each.argument) for each in self.there.log.since(since)]


# Connects a driver to an emulated robot, as the fixture ``driven`` says.
Drivens = Callable[..., Driven]


def wait_for_report(
    robot: Pioneer, reached: Callable[[RobotReport], object], timeout_s: float = 8.0
) -> RobotReport:
    return waiting.until(robot.report, within_s=timeout_s, accept=reached)


@pytest.fixture
def driven(monkeypatch: pytest.MonkeyPatch) -> Iterator[Drivens]:
    """Connect a driver to an emulated robot over TCP or a pseudo terminal.

    Its timeouts for listening and closing are shorter than in the field.

    ``there``: the emulated robot, driven as ``model``; else one of that model is made.
    ``serving``: keywords of ``serve_pty``. ``driving``: keywords of ``Pioneer``.
    """
    monkeypatch.setattr(handshake, "_LISTEN_S", 0.15)
    monkeypatch.setattr(pioneer, "_FAREWELL_S", 0.02)
    monkeypatch.setattr(pioneer, "_SILENT_S", 0.02)
    with ExitStack() as stack:

        def make(
            model: str | None = None,
            *,
            pty: bool = False,
            there: EmulatedRobot | None = None,
            serving: dict[str, Any] | None = None,
            **driving: Any,
        ) -> Driven:
            robot_model = model if there is not None else None
            there = there or EmulatedRobot(model or "p3dx-sh", now=time.monotonic())
            served = serve_pty(there, **(serving or {})) if pty else serve_tcp(there)
            stack.enter_context(served)
            robot = Pioneer(str(served.port), robot_model, **driving)
            stack.callback(robot.close)
            return Driven(robot, served)

        yield make


class ScriptedPeer:
    """A TCP server that runs a script on each connection.

    Attributes:
        port: as ``Pioneer`` takes it. connections: those accepted.
    """

    def __init__(self, script: Callable[[socket.socket], None]) -> None:
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port = f"socket://127.0.0.1:{self._listening.getsockname()[1]}"
        self.connections = 0
        self._script = script
        self._connection: socket.socket | None = None
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        with suppress(OSError):
            while True:
                self._connection, _ = self._listening.accept()
                self.connections += 1
                with suppress(OSError), self._connection:
                    self._script(self._connection)

    def close(self) -> None:
        for each in (self._listening, self._connection):
            if each is not None:
                with suppress(OSError):
                    each.shutdown(socket.SHUT_RDWR)
                each.close()
        self._thread.join(5)


@pytest.fixture
def scripted() -> Iterator[Callable[[Callable[[socket.socket], None]], ScriptedPeer]]:
    """Start a peer that runs ``script(connection)``."""
    with ExitStack() as stack:

        def make(script: Callable[[socket.socket], None]) -> ScriptedPeer:
            peer = ScriptedPeer(script)
            stack.callback(peer.close)
            return peer

        yield make


@pytest.fixture
def piloted() -> Iterator[Callable[..., Pioneer]]:
    """Start a driver on any port."""
    with ExitStack() as stack:

        def make(port: str, model: str | None = None, **driving: Any) -> Pioneer:
            robot = Pioneer(port, model, **driving)
            stack.callback(robot.close)
            return robot

        yield make


@pytest.fixture
def until() -> Callable[..., RobotReport]:
    """Return ``wait_for_report(robot, reached, timeout_s)``."""
    return wait_for_report


@pytest.fixture
def robot(free_port: int) -> Iterator[ExternalRobot]:
    """A custom robot as our side sees it: no client has connected yet."""
    robot = ExternalRobot(f"external:127.0.0.1:{free_port}")
    waiting.until(lambda: robot.report().phase is RobotPhase.WAITING)
    yield robot
    robot.close()


@pytest.fixture
def wire(free_port: int) -> Iterator[Wire]:
    """A wire between ``robot`` and its client."""
    wire = Wire(free_port)
    yield wire
    wire.close()
