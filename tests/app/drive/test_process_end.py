"""However the drive process or its parent ends or hangs, the robots are stopped.

Each test prints its worst value. DRIVE_TRIALS sets how often each fault is tried.
"""

from __future__ import annotations

import contextlib
import os
import random
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from app.contract.drive import SHARED_NAMES
from app.runtime.environment import program_environment

from ...waiting import until
from .driving import PROMISED_S, Drive, Eyes, Robots, report, stays_at_rest, zero_after

HERE = Path(__file__).parent
TRIALS = int(os.environ.get("DRIVE_TRIALS", "2"))


def shut_channel(drive: Drive) -> None:
    drive.sock.shutdown(socket.SHUT_RDWR)


def terminate(drive: Drive) -> None:
    drive.process.terminate()


@pytest.mark.parametrize("end", [shut_channel, terminate])
def test_the_robots_are_stopped_before_the_process_exits(
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
            assert not any(robot.robot.is_open for robot in robots.values()), "no goodbye"
        finally:
            drive.close()
    report(end.__name__, worst)
    assert worst <= PROMISED_S


def test_after_a_kill_the_robot_watchdogs_stop_the_robots(robots: Robots, drive: Drive) -> None:
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


class Parent:
    """``driving_parent.py``, and the times at which it issued its commands."""

    def __init__(self, slots: dict[str, int], robots: Robots) -> None:
        words = [f"{role}={robot.port}" for role, robot in robots.items()]
        fds = [slots[name] for name in SHARED_NAMES]
        self.process = subprocess.Popen(
            [sys.executable, str(HERE / "driving_parent.py"), *map(str, fds), *words],
            stdout=subprocess.PIPE,
            pass_fds=fds,
            env=program_environment(),
        )
        assert self.process.stdout is not None
        os.set_blocking(self.process.stdout.fileno(), False)
        self._text = b""
        try:
            until(self.last_command, "the parent's driving", 30)
        except AssertionError:
            self.close()
            raise

    def last_command(self) -> float | None:
        """Return when the newest command was issued, None if there was none."""
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
def test_a_dead_or_hung_parent_stops_the_robots(
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
            # Only the fault stops the robots here, so the zero must not come before it.
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
        # The drive process says goodbye and exits, whatever happened to its parent.
        until(lambda: not any(r.robot.is_open for r in robots.values()), "goodbye", 5)
    report(number.name, worst)
    assert worst <= PROMISED_S
