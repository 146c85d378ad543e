"""Opening and closing robots in a thread: nothing waits, and no robot is forgotten."""

from __future__ import annotations

import threading
import time
from typing import Any

from app.drive.robot_opener import RobotOpener
from observer.errors import InputError

from ...waiting import until


class SlowRobot:
    """Closes only when the test allows it."""

    def __init__(self, port: str) -> None:
        self.port = port
        self.may_close = threading.Event()
        self.closed = False

    def close(self) -> None:
        assert self.may_close.wait(10)
        self.closed = True


def test_a_slow_close_delays_only_the_next_robot() -> None:
    opener = RobotOpener("observer", lambda port, _: SlowRobot(port))  # type: ignore[arg-type,return-value]
    opener.open("first", None)
    first = until(opener.opened)
    started = time.monotonic()
    opener.close(first)
    opener.open("second", None)
    assert opener.opened() is None
    assert time.monotonic() - started < 1.0
    assert opener.busy
    first.may_close.set()
    second = until(opener.opened)
    assert (first.closed, second.port) == (True, "second")
    until(lambda: not opener.busy)


def test_an_unwanted_robot_is_closed_once_open() -> None:
    may_open = threading.Event()
    opened: list[SlowRobot] = []

    def slow(port: str, model: str | None) -> Any:
        del model
        assert may_open.wait(10)
        opened.append(SlowRobot(port))
        opened[-1].may_close.set()
        return opened[-1]

    opener = RobotOpener("observer", slow)
    opener.open("given up", None)
    opener.close(None)
    may_open.set()
    until(lambda: opened)
    until(lambda: opener.opened() is None and opened[0].closed)
    until(lambda: not opener.busy)


def test_an_opening_failure_is_reported_and_the_next_port_is_tried() -> None:
    def open_robot(port: str, model: str | None) -> Any:
        del model
        if port == "bad":
            raise InputError("there is no such port")
        if port == "worse":
            raise RuntimeError("a bug")
        return SlowRobot(port)

    opener = RobotOpener("observer", open_robot)
    opener.open("bad", None)
    assert until(opener.opened) == "there is no such port"
    opener.open("worse", None)
    assert "failed" in until(opener.opened)
    opener.open("good", None)
    assert until(opener.opened).port == "good"
