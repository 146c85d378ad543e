"""The end of the driver: closed, or failed by a mistake of its own."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from observer.robots import pioneer
from observer.robots.arcos import Command, command
from observer.robots.contract import RobotPhase
from observer.robots.serial_port import open_port

from .arcos_commands import STANDSTILL
from .conftest import Driven, Drivens


@pytest.mark.parametrize("pty", [False, True])
def test_closing_ends_the_session_quickly(
    driven: Drivens, pty: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pioneer, "_FAREWELL_S", 0.1)
    it = driven(pty=pty)
    it.arm()
    it.drive(0.2)
    since = time.monotonic()
    it.robot.close()
    took = time.monotonic() - since
    it.robot.close()
    time.sleep(0.05)
    assert it.heard(since)[-5:] == [*STANDSTILL, (4, 0), (2, None)]
    told = it.there.log.since(since)
    assert told[-1].time - told[-2].time >= 0.09
    assert not it.there.is_open
    assert took < 2.0
    assert it.robot.report().phase is RobotPhase.CLOSED
    assert it.robot.drive(0.3, 0.0).speed_mps == 0.0


class TamperedPort:
    """A real port whose writes may be lost and whose reads may fail.

    Attributes:
        lose: commands that are lost in transit, each once. broken: whether reading fails in a
            way that no port does.
    """

    def __init__(self, text: str) -> None:
        self._port = open_port(text)
        self.lose: list[bytes] = []
        self.broken = False

    def __getattr__(self, name: str) -> Any:
        return getattr(self._port, name)

    def write(self, data: bytes) -> None:
        if data in self.lose:
            self.lose.remove(data)
        else:
            self._port.write(data)

    def read(self, timeout_s: float) -> bytes:
        if self.broken:
            raise RuntimeError("a mistake in the driver")
        return self._port.read(timeout_s)


@pytest.fixture
def tampered(driven: Drivens, monkeypatch: pytest.MonkeyPatch) -> tuple[Driven, TamperedPort]:
    """An armed robot, and the port it is driven through."""
    ports: list[TamperedPort] = []

    def opened(text: str) -> TamperedPort:
        ports.append(TamperedPort(text))
        return ports[-1]

    monkeypatch.setattr(pioneer, "open_port", opened)
    it = driven()
    it.arm()
    it.drive(0.3)
    return it, ports[-1]


def test_a_lost_close_command_is_repeated(
    tampered: tuple[Driven, TamperedPort], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pioneer, "_SILENT_S", 0.15)
    it, port = tampered
    port.lose.append(command(Command.CLOSE))
    began = time.monotonic()
    it.robot.close()
    assert time.monotonic() - began < 2.0
    assert port.lose == []
    time.sleep(0.05)
    assert not it.there.is_open


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_failed_driver_stops_the_robot(tampered: tuple[Driven, TamperedPort]) -> None:
    it, port = tampered
    assert it.there.log.since()[-1].speed_mps > 0
    since = time.monotonic()
    port.broken = True
    report = it.drive_until(lambda report: report.phase is RobotPhase.REFUSED)
    assert report.trouble == report.fault == "its driver failed"
    time.sleep(0.05)
    told = it.there.log.first_standing(since)
    assert told is not None
    assert told.time - since < 0.3
    assert not it.there.motors_enabled


def test_closing_does_not_wait_for_a_missing_robot(
    piloted: Callable[..., Any], tmp_path: Path
) -> None:
    for port in (str(tmp_path / "nothing"), "socket://127.0.0.1:1"):
        robot = piloted(port)
        time.sleep(0.1)
        began = time.monotonic()
        robot.close()
        assert time.monotonic() - began < 1.0
        assert robot.report().phase is RobotPhase.CLOSED
