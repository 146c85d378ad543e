"""A helper process is killed, or a robot's port is not a port.

Engine and server start helper processes: one reads each camera, one computes calibrations, one
aligns with motion capture. The server must continue, say in one sentence what happened, and do
the job when asked again. ``FAULT_TRIALS`` trials each, at most ten.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import psutil
import pytest

from .bench import TRIALS as FAULT_TRIALS
from .bench import tell, wait_until
from .results import keep
from .system import System

TRIALS = min(10, FAULT_TRIALS)
ZERO_S = 0.3
BACK_S = 5.0
READER, CALIBRATION, ALIGNMENT = (
    "observer.sources.cameras.grabber",
    "app.workers.calibration",
    "app.workers.alignment",
)

pytestmark = [pytest.mark.slow, pytest.mark.timeout(150 + 40 * TRIALS)]


def processes(system: System, module: str) -> list[psutil.Process]:
    """Return the server's processes that run a module, oldest first."""
    found = []
    for process in system.server.process.children(recursive=True):
        try:
            if module in process.cmdline():
                found.append(process)
        except psutil.NoSuchProcess:
            continue
    return sorted(found, key=lambda each: each.create_time())


def engine(system: System) -> psutil.Process:
    return psutil.Process(system.server.request("GET", "/status")["engine"]["pid"])


def held(process: psutil.Process) -> tuple[int, int]:
    """Return the number of its file descriptors, and how many of them are shared memory."""
    names = []
    for link in Path(f"/proc/{process.pid}/fd").iterdir():
        try:
            names.append(os.readlink(link))
        except OSError:
            continue
    return len(names), sum("memfd:" in name for name in names)


def works_on(system: System) -> None:
    """Fail unless the same engine continues to observe."""
    status = system.server.request("GET", "/status")
    assert status["engine"]["restarts"] == 0
    before = status["frames_observed"]
    wait_until(
        "frames", lambda: system.server.request("GET", "/status")["frames_observed"] > before + 3
    )


def test_a_camera_reader_is_killed(system: System) -> None:
    zeros: list[float] = []
    backs: list[float] = []
    system.wait_for_sight()
    before = held(engine(system))
    for _ in range(TRIALS):
        system.move()
        readers = processes(system, READER)
        assert len(readers) == 2
        victim = system.random.choice(readers)
        killed = time.monotonic()
        victim.kill()
        zeros.append(system.zero_after(killed))
        told = wait_until(
            "a sentence", lambda: system.server.request("GET", "/status")["live"]["trouble"]
        )
        assert "its process exited unexpectedly" in told
        stood = time.monotonic()
        system.wait_for_sight()
        backs.append(time.monotonic() - killed)
        # It stays armed over such a short gap, but the key still held moves nothing.
        time.sleep(0.4)
        assert not system.moves_since(stood), system.server.robot()["why"]
        assert not victim.is_running()
    # A spare reader is started only once a camera is lost, so only two remain.
    wait_until("two readers", lambda: len(processes(system, READER)) == 2)
    wait_until("nothing else is held", lambda: held(engine(system)) <= before)
    works_on(system)
    tell(
        f"camera reader killed: zero within {1000 * max(zeros):.0f} ms, sees again within "
        f"{max(backs):.1f} s (worst of {TRIALS}); {before[0]} descriptors, {before[1]} of them "
        f"shared memory, as before"
    )
    keep(1, "camera reader killed", trials=TRIALS, worst_ms=round(1000 * max(zeros), 1))
    assert max(zeros) <= ZERO_S
    assert max(backs) <= BACK_S


@pytest.fixture
def other_files(tmp_path: Path, system: System) -> Iterator[dict[str, Path]]:
    """Files someone may enter instead of a port, some of them the server's own."""
    (tmp_path / "notes.txt").write_text("mine")
    os.mkfifo(tmp_path / "pipe")
    data = system.folder
    yield {
        "a file": tmp_path / "notes.txt",
        "the machine's": Path("/etc/passwd"),
        "the server's lock": data / "server.lock",
        "the token": data / "token",
        "a folder": data,
        "a named pipe": tmp_path / "pipe",
        "a device that takes all": Path("/dev/null"),
        "a device that never ends": Path("/dev/zero"),
    }
    system.server.request(
        "PUT", "/robots/observer/port", {"port": system.robot.port, "model": "amigo-sh"}
    )
    system.server.request("DELETE", "/robots/obstacle/port")


def test_ports_that_are_not_serial_ports_are_refused(
    system: System, other_files: dict[str, Path]
) -> None:
    files = {name: path for name, path in other_files.items() if path.is_file()}
    contents = {name: (path.read_bytes(), path.stat().st_mtime_ns) for name, path in files.items()}
    before = system.server.request("GET", "/robots")
    began = time.monotonic()
    for name, path in other_files.items():
        choice = {"port": str(path), "model": "p3dx-sh"}
        system.server.request("PUT", "/robots/obstacle/port", choice)
        told = wait_until(f"{name} is refused", partial(_trouble, system, str(path)))
        assert told.startswith(f"{path} cannot be opened: it is "), told
        assert told.count(". ") == 0
        assert "serial port" in told
        assert system.server.robot("obstacle")["state"] == "waiting"
    # Long enough for a few more attempts.
    time.sleep(1.2)
    for name, path in files.items():
        assert (path.read_bytes(), path.stat().st_mtime_ns) == contents[name], name
    after = system.server.request("GET", "/robots")
    took = time.monotonic() - began
    # The other robot's loop, 50 times a second, was not held up.
    assert after["process"]["pid"] == before["process"]["pid"]
    ticks = after["loop"]["ticks"] - before["loop"]["ticks"]
    assert ticks > 45 * took
    drive = psutil.Process(after["process"]["pid"])
    opened = {each.path for each in drive.open_files()}
    assert not opened & {str(path) for path in other_files.values()}
    tell(
        f"ports that are none: {len(other_files)} refused in a sentence, nothing written; the "
        f"drive loop ran {ticks / took:.1f} times a second"
    )


def _trouble(system: System, port: str) -> str | None:
    robot = system.server.robot("obstacle")
    if robot.get("port") != port or robot["report"] is None:
        return None
    trouble: str | None = robot["report"]["trouble"]
    return trouble


def test_the_alignment_process_is_killed(system: System, capture: Any) -> None:
    system.server.request("PUT", "/truth/live", {"spec": f"vrpn:127.0.0.1:{capture.port}"})
    first = wait_until("it aligns", lambda: processes(system, ALIGNMENT), 30.0)
    before = held(engine(system))
    for trial in range(TRIALS):
        (victim,) = first
        victim.kill()
        first = wait_until("it aligns again", _others(system, ALIGNMENT, victim), 30.0)
        works_on(system)
        truth = system.server.request("GET", "/status")["truth"]
        assert truth["state"] == "receiving"
        assert truth["sentence"]
        log = (system.folder / "server.log").read_text()
        assert log.count(f"{ALIGNMENT} was lost: it ended by SIGKILL") == trial + 1
    assert held(engine(system)) <= before
    (last,) = processes(system, ALIGNMENT)
    system.server.request("PUT", "/truth/live", {"spec": None})
    wait_until("it ends with what it was for", lambda: not last.is_running(), 10.0)
    tell(f"alignment process killed: begun anew {TRIALS} times, and told in the log each time")


@pytest.fixture
def capture() -> Iterator[Any]:
    from .test_truth_faults import MotionCapture

    made = MotionCapture()
    yield made
    made.end()


def _others(system: System, module: str, victim: psutil.Process) -> Callable[[], Any]:
    return lambda: [each for each in processes(system, module) if each != victim]


def test_the_calibration_process_is_killed(system: System) -> None:
    # Last in this file, as it replaces the cameras with a board.
    request = system.server.request
    request("POST", "/calibrating", {"source": "simulated:calibration"})
    before = held(system.server.process)

    def calibrating() -> Any:
        return request("GET", "/calibrating")["calibrating"]

    wait_until("some views", lambda: len(calibrating()["views"]) >= 3, 60.0)
    request("PATCH", "/calibrating", {"automatic": False})
    views = len(calibrating()["views"])
    for _ in range(TRIALS):
        request("POST", "/calibrating/compute", {})
        (victim,) = wait_until("it computes", lambda: processes(system, CALIBRATION), 10.0)
        victim.kill()
        told = wait_until("a sentence", lambda: calibrating()["trouble"], 10.0)
        assert told.startswith("the computation ended by SIGKILL without a result; start it again")
        assert calibrating()["computing"] is None
        assert len(calibrating()["views"]) == views
        assert not processes(system, CALIBRATION)
    # Requested again, it ends normally: with a result, or a sentence about too few views.
    request("POST", "/calibrating/compute", {})
    wait_until("it computes again", lambda: calibrating()["computing"] is None, 60.0)
    again = calibrating()
    assert again["result"] is not None or "view" in again["trouble"], again
    wait_until("nothing is left", lambda: not processes(system, CALIBRATION))
    wait_until("nothing else is held", lambda: held(system.server.process)[1] <= before[1])
    tell(f"calibration process killed: told and asked again {TRIALS} times; {again['trouble']}")
