"""Which clients the port of a custom robot refuses, and where it listens."""

from __future__ import annotations

import contextlib
import json
import os
import resource
import socket
import time

import pytest

from observer.errors import InputError
from observer.robots.contract import RobotPhase
from observer.robots.network.client import ExternalClient, ExternalClientError
from observer.robots.network.robot import ExternalRobot, parse_external

from ....waiting import until
from .sides import RawRobot, driving, reporting

KEY = "a-key-of-the-tests-only"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (b"GET / HTTP/1.1\r\n\r\n", "one JSON object on one line"),
        (b'{"type": "odometry", "enabled": true, "sequence": NaN}\n', "sequence must be"),
        (b"x" * 5000, "at most 4096 bytes"),
        (2000 * b"[" + b"\n", "one JSON object on one line"),
        (b'{"type": "permit"}\n', 'expected a message with "type": "odometry"'),
        (1001 * (json.dumps({"type": "odometry", "sequence": 0, "time": 0, "x": 0, "y": 0,
         "yaw": 0, "speed_mps": 0, "turn_rate_radps": 0, "enabled": False, "permit": 0})
         .encode() + b"\n"), "at most 1000 messages per second"),
    ],
)  # fmt: skip
def test_garbage_ends_the_connection_with_the_reason(
    robot: ExternalRobot, free_port: int, text: bytes, sentence: str
) -> None:
    raw = RawRobot(free_port)
    raw.odometry(1)
    until(lambda: robot.report().received is not None)
    raw.socket.sendall(text)
    last = raw.last()
    assert last is not None
    assert last["type"] == "refused"
    assert sentence in last["sentence"]
    fault = robot.report().fault
    assert fault is not None
    assert fault.startswith("the robot sent an invalid message: ")
    assert robot.report().phase is RobotPhase.WAITING
    raw.close()


def test_a_second_robot_is_refused_while_the_first_is_connected(
    robot: ExternalRobot, free_port: int
) -> None:
    with reporting(free_port, name="first") as client, driving(robot, client):
        with pytest.raises(ExternalClientError, match="another robot is already connected here"):
            ExternalClient("127.0.0.1", free_port, name="second").connect()
        time.sleep(0.1)
        assert client.permitted().speed_mps == 0.3
        assert robot.report().name == "first"
        assert robot.report().fault is None


def test_a_new_connection_replaces_a_silent_one(robot: ExternalRobot, free_port: int) -> None:
    raw = RawRobot(free_port)
    raw.odometry(1)
    until(lambda: robot.report().fault is not None)
    with reporting(free_port, name="again") as client:
        until(lambda: robot.report().name == "again")
        last = raw.last()
        assert last is not None
        assert last["sentence"] == "another robot replaced it"
        assert client.permitted().stop
        with driving(robot, client):
            assert robot.report().counters["reconnects"] == 1
    raw.close()


def test_a_robot_waits_without_a_busy_loop_while_no_file_can_be_opened(free_port: int) -> None:
    turns = 0

    def counting() -> float:
        # Each turn of the listening thread looks at the clock.
        nonlocal turns
        turns += 1
        return time.monotonic()

    robot = ExternalRobot(f"external:127.0.0.1:{free_port}", clock=counting)
    with contextlib.closing(robot), socket.socket() as connecting:
        until(lambda: robot.report().phase is RobotPhase.WAITING)
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        lowest_free = os.dup(0)
        os.close(lowest_free)
        resource.setrlimit(resource.RLIMIT_NOFILE, (lowest_free, hard))
        try:
            connecting.connect(("127.0.0.1", free_port))
            before = turns
            time.sleep(0.4)
            taken = turns - before
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
        assert taken < 10
        connecting.sendall(json.dumps(RawRobot.HELLO).encode() + b"\n")
        until(lambda: robot.report().name == "raw")


def test_a_client_that_sends_no_hello_is_disconnected(
    robot: ExternalRobot, free_port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("observer.robots.network.link._HELLO_WITHIN_S", 0.2)
    with socket.create_connection(("127.0.0.1", free_port), timeout=5) as silent:
        assert b"send hello within" in silent.makefile("rb").readline()
    strangers = [socket.create_connection(("127.0.0.1", free_port), timeout=5) for _ in range(8)]
    until(lambda: all(each.recv(1) for each in strangers))
    for each in strangers:
        each.close()
    with reporting(free_port):
        assert robot.report().phase is RobotPhase.CONNECTED


def test_a_configured_key_is_required(free_port: int) -> None:
    robot = ExternalRobot(f"external:127.0.0.1:{free_port}?key={KEY}")
    until(lambda: robot.report().phase is RobotPhase.WAITING)
    for wrong in (None, "", "wrong", KEY + "x"):
        with pytest.raises(ExternalClientError, match="wrong key"):
            ExternalClient("127.0.0.1", free_port, key=wrong).connect()
    assert "wrong key" in (robot.report().trouble or "")
    assert KEY not in str(robot.report())
    with reporting(free_port, key=KEY):
        assert robot.report().phase is RobotPhase.CONNECTED
        assert robot.report().trouble is None
    robot.close()


def test_the_listening_address_is_parsed_strictly() -> None:
    assert parse_external("external:localhost:7700").host == "localhost"
    assert parse_external("external:[::1]:7700").host == "::1"
    open_to_others = parse_external(f"external:0.0.0.0:7700?key={KEY}")
    assert (open_to_others.port, open_to_others.key) == (7700, KEY)
    for text, sentence in (
        ("external:0.0.0.0:7700", "can be reached from other machines; add a key"),
        ("external:[::]:7700", "can be reached from other machines; add a key"),
        ("external:robot.lab:7700", "can be reached from other machines; add a key"),
        ("external:127.0.0.1", "write it as external:127.0.0.1:7700"),
        ("external:127.0.0.1:0", "write it as"),
        ("external:127.0.0.1:70000", "write it as"),
        ("external:127.0.0.1:7700/x", "write it as"),
        ("127.0.0.1:7700", "write it as"),
        ("external:127.0.0.1:7700?key=short", "16 to 128"),
        ("external:127.0.0.1:7700?token=" + KEY, "followed by key="),
    ):
        with pytest.raises(InputError, match=sentence) as refused:
            parse_external(text)
        assert KEY not in str(refused.value)
    with pytest.raises(InputError, match="no robot model"):
        ExternalRobot("external:127.0.0.1:7700", "tank")


def test_a_port_in_use_is_reported_and_retried(
    free_port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("observer.robots.network.link._RETRY_S", 0.05)
    with socket.create_server(("127.0.0.1", free_port)):
        robot = ExternalRobot(f"external:127.0.0.1:{free_port}")
        until(lambda: "cannot listen" in (robot.report().trouble or ""))
    until(lambda: "no robot has connected" in (robot.report().trouble or ""))
    robot.close()
