"""The wall clock jumps by an hour while a robot drives and a run is recorded.

Only the server's processes see the jump (``wall_clock.c``), so this needs a C compiler. Each test
makes ``FAULT_TRIALS`` trials.
"""

from __future__ import annotations

import os
import shutil
import signal
import struct
import subprocess
import sys
import time
from datetime import UTC, datetime
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from observer.recording.reader import Recording

from .bench import TRIALS, tell, wait_until
from .cameras import RATE_HZ
from .system import System

ZERO_S = 0.3
HOUR_S = 3600
# A busy machine stops the robot occasionally; a fault of the clock would do so every time.
TRIES = 5

# The effect on runs is also covered by test_current_run.
pytestmark = [
    pytest.mark.slow,
    pytest.mark.patient,
    pytest.mark.timeout(120 + 40 * TRIALS),
]


class WallClock:
    """The time of day as seen by the server's processes.

    Attributes:
        environment: variables that make them see it.
    """

    def __init__(self, folder: Path) -> None:
        compiler = shutil.which("cc")
        if compiler is None or sys.platform != "linux":
            pytest.skip("a clock that jumps needs Linux and a C compiler (apt-get install gcc)")
        library = folder / "wall_clock.so"
        source = Path(__file__).with_name("wall_clock.c")
        subprocess.run(
            [compiler, "-shared", "-fPIC", "-O2", "-Wall", "-Werror", "-o", str(library), source],
            check=True,
        )
        self._file = folder / "shift"
        self.environment = {"LD_PRELOAD": str(library), "WALL_CLOCK_SHIFT": str(self._file)}
        self.shift_s = 0
        self.jump(0)

    def jump(self, shift_s: int) -> None:
        """Run this many seconds ahead of the true time from now on."""
        self.shift_s = shift_s
        with self._file.open("r+b" if self._file.exists() else "wb", buffering=0) as file:
            file.write(struct.pack("=q", shift_s))

    def now(self) -> float:
        """Return the time that they see."""
        return time.time() + self.shift_s


def test_the_wall_clock_jumps(tmp_path: Path) -> None:
    clock = WallClock(tmp_path)
    jumps = cycle((-HOUR_S, 0, HOUR_S, -HOUR_S))
    zeros: list[float] = []
    with System(tmp_path / "data", clock.environment).running() as system:
        server = system.server
        for process in server.process.children(recursive=True):
            assert process.environ().get("LD_PRELOAD") == clock.environment["LD_PRELOAD"]
        started = time.monotonic()
        run = server.request("POST", "/runs", {"name": "jumps", "record": "jpeg"})["id"]
        wait_until("frames", lambda: server.request("GET", f"/runs/{run}")["frames"] > 3, 20.0)
        for trial in range(TRIALS):
            _drive_through(system, clock, next(jumps))
            # What stops a robot still does: the operator's silence and blind cameras.
            zeros.append(_silence(system) if trial % 2 == 0 else _blindness(system))
        server.request("POST", f"/runs/{run}/stop")
        elapsed = time.monotonic() - started
        record = server.request("GET", f"/runs/{run}")
        rows = server.request("GET", f"/runs/{run}/speeds")
    lasted = _seconds(record["ended_at"]) - _seconds(record["started_at"])
    file = tmp_path / "data" / "runs" / run / "recording.mcap"
    backward, span, gap = _judge_recording(file)
    tell(
        f"fault 12, wall clock jumps {HOUR_S} s: driving goes on, zero within "
        f"{1000 * max(zeros):.0f} ms (worst of {TRIALS}), a run of {elapsed:.1f} s lasted "
        f"{lasted:.1f} s, its recording spans {span:.1f} s, goes back by {1000 * backward:.0f} ms "
        f"at most, largest gap {gap:.2f} s"
    )
    assert max(zeros) <= ZERO_S
    assert abs(lasted - elapsed) < 5.0
    assert abs(span - elapsed) < 5.0
    assert backward < 1.0
    times = [row["time"] for row in rows]
    assert max(times) - min(times) < elapsed + 1.0


def test_the_wall_clock_jumps_before_the_drive_process_starts(tmp_path: Path) -> None:
    """It also jumps before each restart: every drive process starts in another hour."""
    clock = WallClock(tmp_path)
    jumps = cycle((HOUR_S, -HOUR_S, 0))
    # The server starts with its clock an hour slow.
    clock.jump(-HOUR_S)
    zeros: list[float] = []
    backs: list[float] = []
    with System(tmp_path / "data", clock.environment).running() as system:
        system.move()
        zeros.append(_silence(system))
        for trial in range(TRIALS):
            clock.jump(next(jumps))
            backs.append(_restart_drive_process(system))
            _drive_through(system, clock, next(jumps))
            zeros.append(_silence(system) if trial % 2 == 0 else _blindness(system))
    tell(
        f"fault 12, drive process begun in another hour: zero within {1000 * max(zeros):.0f} ms, "
        f"connected again {max(backs):.1f} s after its predecessor's end (worst of {TRIALS})"
    )
    assert max(zeros) <= ZERO_S


def _restart_drive_process(system: System) -> float:
    """Kill the drive process; return the seconds until the next one has connected the robot."""

    def pid() -> int:
        found: int = system.server.request("GET", "/robots")["process"]["pid"]
        return found

    killed, before = time.monotonic(), pid()
    os.kill(before, signal.SIGKILL)

    def is_back() -> bool:
        return pid() != before and system.server.robot().get("state") == "disarmed"

    wait_until("the robot is connected again", is_back, 15.0)
    return time.monotonic() - killed


def _drive_through(system: System, clock: WallClock, shift_s: int) -> None:
    """Let the clock jump; the robot must drive on as if nothing had happened."""
    for _ in range(TRIES):
        system.move()
        before = clock.shift_s
        clock.jump(shift_s)
        jumped = time.monotonic()
        time.sleep(1.0)
        if system.robot.robot.log.first_standing(jumped) is None:
            # Make sure the server saw the jump.
            told = system.server.api.get("/api/status").headers["date"]
            seen = datetime.strptime(told, "%a, %d %b %Y %H:%M:%S GMT").replace(tzinfo=UTC)
            assert abs(seen.timestamp() - clock.now()) < 60.0
            return
        clock.jump(before)
    raise AssertionError(f"stopped by each of {TRIES} jumps: {system.server.robot()}")


def _silence(system: System) -> float:
    """Return the seconds to zero since the operator's last message."""
    operator = system.operator
    assert operator is not None
    operator.mute = True
    time.sleep(0.05)
    return system.zero_after(operator.last_sign)


def _blindness(system: System) -> float:
    """Return the seconds to zero since a camera's last picture."""
    system.left.does.hangs = True
    time.sleep(1.5 / RATE_HZ)
    return system.zero_after(system.left.good_at)


def _judge_recording(path: Path) -> tuple[float, float, float]:
    """Return the largest backward step and the span of its messages, and the longest frame gap."""
    with path.open("rb") as file:
        logged = [m.log_time / 1e9 for _, _, m in make_reader(file).iter_messages(None)]
    stamps = np.array(logged)
    with Recording(path) as recording:
        frames: Any = recording.frames
    received = np.array([frame.received for frame in frames])
    times = np.array([frame.time for frame in frames])
    assert (np.diff(received) > 0).all()
    assert (np.diff(times) > 0).all()
    backward = float(np.max(np.maximum.accumulate(stamps) - stamps))
    return backward, float(np.ptp(stamps)), float(np.diff(received).max())


def _seconds(text: str) -> float:
    return datetime.fromisoformat(text).timestamp()
