"""Opening a session, whatever the robot or the previous client does."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from observer.robots import handshake, pioneer
from observer.robots.arcos import Command, PacketParser, command, decode_command, packet
from observer.robots.contract import RobotPhase
from observer.simulation.robots.emulated import EmulatedRobot

SYNC2 = packet(b"\x02Robby\0Pioneer\0P3DX-SH\0")
STATUS = packet(bytes([0x32]) + bytes(19))
STANDSTILL_THEN_CLOSE = [(29, None), (11, 0), (21, 0), (4, 0), (2, None)]


@pytest.fixture
def hurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Shorten the wait for SYNC to a tenth of a second."""
    monkeypatch.setattr(handshake, "_SYNC_S", 0.1)


class Heard:
    """Reads commands and sends the answer to each.

    Attributes:
        commands: numbers and arguments of all connections, in order.
        first: how many of them came on the first connection; None while it is open.
    """

    def __init__(self) -> None:
        self.commands: list[tuple[int, int | bytes | None]] = []
        self.first: int | None = None

    def serve(self, connection: socket.socket, answer: Callable[[int, int], bytes]) -> None:
        """Serve until it ends. ``answer``: given a command's number and how often it has come."""
        try:
            self._read(connection, answer)
        finally:
            self.first = len(self.commands) if self.first is None else self.first

    def _read(self, connection: socket.socket, answer: Callable[[int, int], bytes]) -> None:
        parser, seen = PacketParser(), dict.fromkeys(range(256), 0)
        while data := connection.recv(4096):
            for payload in parser.feed(data):
                read = decode_command(payload)
                self.commands.append((read.number, read.argument))
                seen[read.number] += 1
                connection.sendall(answer(read.number, seen[read.number]))


@pytest.fixture
def heard() -> Heard:
    return Heard()


@pytest.fixture
def answered(
    scripted: Callable[..., Any], piloted: Callable[..., Any], heard: Heard
) -> Callable[..., Any]:
    """Return a driver on a port where ``heard`` answers like this."""
    return lambda answer: piloted(scripted(lambda connection: heard.serve(connection, answer)).port)


def echo(number: int) -> bytes:
    return {0: command(0), 1: command(1), 2: SYNC2}.get(number, b"")


def test_a_robot_connects_at_once_with_its_motors_off(driven: Callable[..., Any]) -> None:
    it = driven()
    report = it.connect()
    assert report.name == "emulated Pioneer P3-DX"
    assert (report.model, report.subtype) == ("p3dx-sh", "p3dx-sh")
    assert report.watchdog_s == 2.0
    assert report.trouble is report.fault is None
    numbers = [number for number, _ in it.heard()]
    assert numbers[:4] == [0, 1, 2, 1]
    # Stand still before PULSE, which would restart a robot that its watchdog stopped.
    at = numbers.index(29)
    assert it.heard()[at : at + 4] == [(29, None), (11, 0), (21, 0), (4, 0)]
    assert at < numbers.index(int(Command.CONFIG))
    assert (4, 1) not in it.heard()
    assert {(18, None), (19, 0), (28, 1)} <= set(it.heard())
    assert {each for each, _ in it.heard()} >= {5, 6, 10, 23}
    assert not {253, 255} & set(numbers)


def test_a_session_left_by_a_dead_client_is_closed_first(
    driven: Callable[..., Any],
) -> None:
    there = EmulatedRobot("p3dx-sh", now=time.monotonic())
    there.begin_session(time.monotonic())
    it = driven(there=there, pty=True)
    it.connect()
    told = it.heard()
    assert told[:5] == STANDSTILL_THEN_CLOSE
    assert told[5:8] == [(0, None), (1, None), (2, None)]


@pytest.mark.usefixtures("hurried")
def test_a_status_packet_in_reply_to_sync_ends_the_old_session(
    answered: Callable[..., Any], until: Callable[..., Any], heard: Heard
) -> None:
    def answer(number: int, time_: int) -> bytes:
        return STATUS if (number, time_) == (0, 1) else echo(number)

    until(answered(answer), lambda report: report.name == "Robby")
    assert heard.commands[0] == (0, None)
    assert heard.commands[1:6] == STANDSTILL_THEN_CLOSE
    assert heard.commands[6:8] == [(0, None), (1, None)]


@pytest.mark.usefixtures("hurried")
def test_an_unexpected_reply_restarts_the_handshake(
    answered: Callable[..., Any], until: Callable[..., Any], heard: Heard
) -> None:
    def answer(number: int, time_: int) -> bytes:
        # Mid-session, with the echo of SYNC 1 arriving late after it.
        return packet(b"\xff") + command(1) if (number, time_) == (1, 1) else echo(number)

    until(answered(answer), lambda report: report.name == "Robby")
    assert [number for number, _ in heard.commands[:5]] == [0, 1, 0, 1, 2]


@pytest.mark.parametrize("nonsense", [b"", packet(b"\xff")])
@pytest.mark.usefixtures("hurried")
def test_it_gives_up_with_the_reason_and_retries_by_itself(
    nonsense: bytes,
    answered: Callable[..., Any],
    until: Callable[..., Any],
    heard: Heard,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(pioneer, "_PAUSE_S", 0.1)
    robot = answered(lambda *_: nonsense)
    report = until(robot, lambda report: report.phase is RobotPhase.WAITING)
    # The last command may still be in transit.
    until(robot, lambda _: heard.first is not None)
    tries = [number for number, _ in heard.commands[: heard.first]].count(0)
    if nonsense:
        assert tries == 10
        assert "power-cycle it" in report.trouble
    else:
        assert tries == 5
        assert "check that it is switched on" in report.trouble
        # After two silent tries.
        assert heard.commands[:7] == [(0, None), (0, None), *STANDSTILL_THEN_CLOSE]
    assert report.fault is None
    until(robot, lambda _: len(heard.commands) > heard.first)


@pytest.mark.usefixtures("hurried")
def test_a_robot_connects_once_it_is_switched_on(
    driven: Callable[..., Any],
) -> None:
    there = EmulatedRobot("amigo-sh", now=time.monotonic())
    there.faults.no_sync_reply = True
    it = driven(there=there)
    it.until(lambda report: report.phase is RobotPhase.WAITING)
    there.faults.no_sync_reply = False
    assert it.connect().trouble is None


@pytest.mark.usefixtures("hurried")
def test_a_silent_serial_line_is_sent_close_at_every_rate(
    driven: Callable[..., Any],
) -> None:
    # It was left in a session at 57600 baud; at 9600 both sides receive garbage.
    there = EmulatedRobot("p3dx-sh", now=time.monotonic())
    there.begin_session(time.monotonic())
    there.baud = 57600
    it = driven(there=there, pty=True, serving={"rates": True})
    it.connect()
    told = it.heard()
    at = told.index((2, None))
    assert told[at - 4 : at + 1] == STANDSTILL_THEN_CLOSE
    assert (0, None) not in told[:at], "PULSE to a robot in a session"


def test_a_higher_rate_is_negotiated_and_reset_on_closing(driven: Callable[..., Any]) -> None:
    it = driven("p3dx-sh", pty=True, serving={"rates": True})
    it.connect()
    assert it.there.baud == 38400
    assert (50, 2) in it.heard()
    it.arm()
    it.robot.close()
    assert it.there.baud == 9600


class Stubborn(EmulatedRobot):
    """Ignores HOSTBAUD, as some serial adapters do not know a higher rate."""

    @property
    def baud(self) -> int:
        return 9600

    @baud.setter
    def baud(self, rate: int) -> None:
        del rate


def test_a_rate_without_a_reply_is_given_up(driven: Callable[..., Any]) -> None:
    it = driven(there=Stubborn("p3dx-sh", now=time.monotonic()), pty=True, serving={"rates": True})
    it.connect()
    it.arm()
    it.drive(0.3)
    assert it.robot.report().speed_mps > 0.05


def test_no_rate_is_negotiated_over_tcp(driven: Callable[..., Any]) -> None:
    it = driven("p3dx-sh")
    it.connect()
    assert all(number != 50 for number, _ in it.heard())


def test_an_unknown_robot_is_refused_and_disconnected(driven: Callable[..., Any]) -> None:
    it = driven(there=EmulatedRobot("p3dx-sh", now=time.monotonic(), subtype="PowerBot-SH"))
    report = it.until(lambda report: report.phase is RobotPhase.REFUSED)
    assert "'powerbot-sh'" in report.trouble
    assert "amigo-sh" in report.trouble
    it.until(lambda _: not it.serving.connected)
    assert all(number <= 2 for number, _ in it.heard())


def test_a_given_model_overrides_the_reported_one(
    driven: Callable[..., Any],
) -> None:
    there = EmulatedRobot("p3dx-sh", now=time.monotonic(), subtype="powerbot-sh")
    report = driven("p3dx", there=there).connect()
    assert report.model == "p3dx"
    assert report.warnings == ("it identifies itself as 'powerbot-sh' but is driven as p3dx",)


def test_a_lost_connection_is_reported_with_its_port(
    scripted: Callable[..., Any], piloted: Callable[..., Any], until: Callable[..., Any]
) -> None:
    peer = scripted(lambda _: None)
    report = until(piloted(peer.port), lambda report: report.phase is RobotPhase.WAITING)
    assert f"the connection to {peer.port} was lost" in report.trouble


def test_a_port_that_cannot_be_opened_is_reported_with_the_reason(
    piloted: Callable[..., Any],
    until: Callable[..., Any],
    free_port: int,
    tmp_path: Path,
) -> None:
    (tmp_path / "file").write_text("no port")
    for port, words in (
        (f"socket://127.0.0.1:{free_port}", "connection refused"),
        (str(tmp_path / "nothing"), "there is no such device"),
        (str(tmp_path / "file"), "it is a file, not a serial port"),
    ):
        report = until(piloted(port), lambda report: report.phase is RobotPhase.WAITING)
        assert report.trouble == f"{port} cannot be opened: {report.trouble.split(': ', 1)[1]}"
        assert words in report.trouble
        assert report.fault is None


def test_a_serial_port_has_one_owner(
    driven: Callable[..., Any], piloted: Callable[..., Any], until: Callable[..., Any]
) -> None:
    it = driven(pty=True)
    it.connect()
    second = piloted(str(it.serving.port))
    report = until(second, lambda report: report.phase is RobotPhase.WAITING)
    assert "in use by another program" in report.trouble
    assert it.robot.report().phase is RobotPhase.CONNECTED
