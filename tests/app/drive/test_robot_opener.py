"""Opening and closing robots in a thread: nothing waits, and no robot is forgotten."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from app.drive.robot_opener import AttendantThread
from observer.errors import InputError


class SlowRobot:
    """Closes only when the test allows it."""

    def __init__(self, port: str) -> None:
        self.port = port
        self.may_close = threading.Event()
        self.closed = False

    def close(self) -> None:
        assert self.may_close.wait(10)
        self.closed = True


def until(found: Callable[[], Any]) -> Any:
    deadline = time.monotonic() + 10
    while not (result := found()):
        assert time.monotonic() < deadline
        time.sleep(0.002)
    return result


def test_a_slow_close_delays_only_the_next_robot() -> None:
    attendant = AttendantThread("observer", lambda port, _: SlowRobot(port))  # type: ignore[arg-type,return-value]
    attendant.open("first", None)
    first = until(attendant.opened)
    started = time.monotonic()
    attendant.close(first)
    attendant.open("second", None)
    assert attendant.opened() is None
    assert time.monotonic() - started < 1.0
    assert attendant.busy
    first.may_close.set()
    second = until(attendant.opened)
    assert (first.closed, second.port) == (True, "second")
    until(lambda: not attendant.busy)


def test_an_unwanted_robot_is_closed_once_open() -> None:
    may_open = threading.Event()
    opened: list[SlowRobot] = []

    def slow(port: str, model: str | None) -> Any:
        del model
        assert may_open.wait(10)
        opened.append(SlowRobot(port))
        opened[-1].may_close.set()
        return opened[-1]

    attendant = AttendantThread("observer", slow)
    attendant.open("given up", None)
    attendant.close(None)
    may_open.set()
    until(lambda: opened)
    until(lambda: attendant.opened() is None and opened[0].closed)
    until(lambda: not attendant.busy)


def test_an_opening_failure_is_reported_and_the_next_port_is_tried() -> None:
    def opener(port: str, model: str | None) -> Any:
        del model
        if port == "bad":
            raise InputError("there is no such port")
        if port == "worse":
            raise RuntimeError("a bug")
        return SlowRobot(port)

    attendant = AttendantThread("observer", opener)
    attendant.open("bad", None)
    assert until(attendant.opened) == "there is no such port"
    attendant.open("worse", None)
    assert "failed" in until(attendant.opened)
    attendant.open("good", None)
    assert until(attendant.opened).port == "good"
