"""What must happen when something fails while the robot drives to a goal autonomously."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable

import pytest

from .bench import TRIALS, Refused, wait_until
from .operator import arm
from .results import worst_of
from .system import System

ZERO_S = 0.3
_AHEAD_M = 3.0
_MOVES_MPS = 0.15
_PATIENCE_S = 60.0

pytestmark = [pytest.mark.slow, pytest.mark.timeout(120 + 30 * TRIALS)]


def _send(system: System) -> None:
    """Send the robot ahead, whatever its state, and wait until it moves."""
    deadline = time.monotonic() + _PATIENCE_S
    while not _sent(system):
        goal = system.server.request("GET", "/robots")["goal"]
        assert time.monotonic() < deadline, f"it does not drive to its goal: {goal}"


def _sent(system: System) -> bool:
    system.wait_for_sight()
    operator = system.sit_down()
    if operator.lease is None:
        assert operator.take(takeover=True)["state"] == "yours"
    operator.release()
    arm(system.server, operator)
    try:
        system.server.request(
            "POST", "/goal", {"ahead_m": _AHEAD_M, "left_m": 0.0, "lease": operator.lease}
        )
    except Refused:
        # On a busy machine a presence message is occasionally late.
        return False
    try:
        wait_until("it moves", lambda: system.robot.robot.speed_mps > _MOVES_MPS, 5.0)
    except AssertionError:
        return False
    return True


def _kill_engine(system: System) -> None:
    pid = system.server.request("GET", "/status")["engine"]["pid"]
    os.kill(pid, system.random.choice([signal.SIGKILL, signal.SIGSTOP]))


@pytest.mark.parametrize(
    ("name", "fail"),
    [
        ("page closed on the way to a goal", lambda system: system.leave(abruptly=True)),
        ("engine killed on the way to a goal", _kill_engine),
        ("goal given up", lambda system: system.server.request("DELETE", "/goal")),
    ],
    ids=["page", "engine", "given_up"],
)
def test_the_robot_stops_and_does_not_resume_its_goal(
    system: System, name: str, fail: Callable[[System], object]
) -> None:
    def once() -> float:
        _send(system)
        failed = time.monotonic()
        fail(system)
        seconds = system.zero_after(failed)
        stood = time.monotonic()
        system.wait_for_sight()
        # An operator who comes back has to send it again.
        system.sit_down()
        time.sleep(0.5)
        moves = system.moves_since(stood)
        assert not moves, moves[:2]
        assert system.server.request("GET", "/robots")["goal"]["state"] == "ended"
        return seconds

    worst_of(30, name, once, within=ZERO_S)
