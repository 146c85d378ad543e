"""What EXTERNAL.md says about a custom robot matches the real one."""

from __future__ import annotations

import json
import re
import threading
import time
from collections.abc import Callable
from typing import Any

import pytest

from observer.robots.contract import RobotPhase
from observer.robots.network.client import ExternalClientError
from observer.robots.network.link import EXPIRES_S, PERMIT_INTERVAL_S
from observer.robots.network.messages import (
    Permit,
    parse_hello,
    parse_odometry,
    permit_line,
    welcome_line,
)
from observer.robots.network.robot import ExternalRobot, parse_external
from tools import ROOT

DRIVE_S = 0.02


@pytest.fixture(scope="module")
def document() -> str:
    return (ROOT / "observer" / "robots" / "EXTERNAL.md").read_text(encoding="utf-8")


def _block(document: str, language: str) -> str:
    (text,) = re.findall(rf"^```{language}\n(.*?)^```$", document, re.M | re.S)
    return str(text)


def _until(is_so: Callable[[], bool], keep: Callable[[], object] = lambda: None) -> None:
    deadline = time.monotonic() + 8.0
    while not is_so():
        assert time.monotonic() < deadline
        keep()
        time.sleep(DRIVE_S)


def test_the_documented_example_drives_and_stops(document: str, free_port: int) -> None:
    example = _block(document, "python")
    assert len([line for line in example.splitlines() if line.strip()]) <= 15
    assert example.count("7700") == 1
    program = compile(example.replace("7700", str(free_port)), "EXTERNAL.md", "exec")
    ended: list[str] = []
    names: dict[str, Any] = {}

    def run() -> None:
        try:
            exec(program, names)
            ended.append("disconnected")
        except ExternalClientError as error:
            ended.append(str(error))
        finally:
            # As happens when its process ends.
            names["client"].close()

    robot = ExternalRobot(f"external:127.0.0.1:{free_port}")
    thread = threading.Thread(target=run)
    try:
        _until(lambda: robot.report().phase is RobotPhase.WAITING)
        thread.start()
        _until(lambda: robot.report().received is not None)
        assert robot.report().name == "Robbie"
        robot.enable()

        def x() -> float:
            odometry = robot.report().odometry
            return 0.0 if odometry is None else odometry.x

        _until(lambda: x() > 0.05, lambda: robot.drive(0.3, 0.0))
        report = robot.report()
        assert (report.fault, report.motors_enabled) == (None, True)
        robot.stop()
        _until(lambda: robot.report().motors_enabled is False)
        assert robot.report().speed_mps == 0.0
        stopped_at = x()
        time.sleep(0.2)
        assert x() == stopped_at
        assert robot.report().fault is None
        assert not ended
    finally:
        robot.close()
        if thread.ident is not None:
            thread.join(5.0)
    assert len(ended) == 1


def test_the_documented_messages_match_the_protocol(document: str) -> None:
    lines = _block(document, "json").splitlines()
    hello, welcome, odometry, permit = lines
    said = parse_hello(hello.encode())
    assert (said.mode, said.key, said.radius_m) == ("driven", "KEY", 0.3)
    told = parse_odometry(odometry.encode())
    assert (told.permit, told.wanted) == (391, (0.4, 0.0))
    assert json.loads(welcome) == json.loads(welcome_line(PERMIT_INTERVAL_S, EXPIRES_S))
    ours = permit_line(Permit(0.2, 0.0, False, "1.2 m before an obstacle"), 392, 5021.7, EXPIRES_S)
    assert json.loads(permit) == json.loads(ours)
    # Every key has a row in the table, except those that the units explain.
    explained = set(re.findall(r"`(\w+)`", "".join(re.findall(r"^\| (`.*?) \|", document, re.M))))
    plain = {"type", "protocol", "name", "speed_mps", "turn_rate_radps", "interval_ms"}
    for line in lines:
        assert set(json.loads(line)) <= explained | plain


def test_the_documented_ports_are_accepted(document: str) -> None:
    key = "0123456789abcdef"
    ports = re.findall(r"^\| `(external:\S+)` \|", document, re.M)
    assert len(ports) == 3
    assert [parse_external(each.replace("KEY", key)).port for each in ports] == [7700] * 3
