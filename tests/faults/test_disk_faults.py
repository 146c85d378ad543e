"""The disk fills up while a robot drives and a run is recorded.

The data are on a small disk of their own, which only root can mount. ``FAULT_TRIALS`` trials, at
most ten.
"""

from __future__ import annotations

import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from observer.recording.reader import Recording

from .bench import TRIALS as FAULT_TRIALS
from .bench import Refused, tell, wait_until
from .system import System

TRIALS = min(10, FAULT_TRIALS)
ZERO_S = 0.3
ENDS_S = 5.0
# The free space that a recording keeps, plus room for some recording.
DISK_MB = 200 + 120

pytestmark = [pytest.mark.slow, pytest.mark.timeout(120 + 40 * TRIALS)]


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """Mount a disk of ``DISK_MB``."""
    folder = tmp_path / "disk"
    folder.mkdir()
    options = ["-t", "tmpfs", "-o", f"size={DISK_MB}m", "none"]
    try:
        made = subprocess.run(["mount", *options, str(folder)], capture_output=True, check=False)
    except OSError:
        made = None
    if made is None or made.returncode:
        pytest.skip("a disk that can be filled needs root's mount")
    yield folder
    subprocess.run(["umount", "--lazy", str(folder)], check=True)


@contextmanager
def filled(disk: Path) -> Iterator[None]:
    """Fill the disk to the last byte, even if others write."""
    filler = disk / "filler"
    with filler.open("wb", buffering=0) as file:
        for block in (1 << 20, 1 << 12):
            _fill(file, bytes(block))
    try:
        yield
    finally:
        filler.unlink()


def _fill(file: Any, block: bytes) -> None:
    while True:
        try:
            file.write(block)
        except OSError:
            # Less than a block is left.
            return


def begin_run(system: System) -> str:
    """Start a run; return once some of it is on the disk."""

    def recorded() -> bool:
        told = system.server.request("GET", "/status")["recording"]
        return told is not None and told["seconds"] > 1.0 and told["bytes"] > 100_000

    run = system.server.request("POST", "/runs", {"name": "fills the disk", "record": "jpeg"})
    wait_until("a recording", recorded, 30.0)
    id: str = run["id"]
    return id


def frames_of(system: System, run: str) -> int:
    frames: int = system.server.request("GET", f"/runs/{run}")["frames"]
    return frames


def finished(system: System, run: str) -> Any:
    record = system.server.request("GET", f"/runs/{run}")
    return record if record["state"] == "finished" else None


def refusal(system: System, method: str, path: str, body: Any) -> Refused | None:
    try:
        system.server.request(method, path, body)
    except Refused as refused:
        return refused
    return None


@pytest.mark.patient
def test_the_disk_fills_up(disk: Path) -> None:
    ended: list[float] = []
    zeros: list[float] = []
    stops: list[float] = []
    kept: list[float] = []
    with System(disk / "data").running() as system:
        server = system.server
        for _ in range(TRIALS):
            run = begin_run(system)
            file = disk / "data" / "runs" / run / "recording.mcap"
            system.move()
            before = frames_of(system, run)
            with filled(disk):
                full = time.monotonic()
                trouble = wait_until(
                    "the recording's end",
                    lambda: server.request("GET", "/status")["recording"]["trouble"],
                    10.0,
                )
                ended.append(time.monotonic() - full)
                assert "disk" in trouble
                # The run continues without recording, and so does driving.
                system.move()
                asked = time.monotonic()
                server.request("POST", "/robots/stop")
                zeros.append(system.zero_after(asked))
                assert frames_of(system, run) > before
                for path, body in (("/presets", {"name": "no room"}), ("/robots/reset", None)):
                    refused = refusal(system, "POST", path, body)
                    assert refused is None or refused.status == 507, refused
                asked = time.monotonic()
                stopped = server.request("POST", f"/runs/{run}/stop")
                stops.append(time.monotonic() - asked)
                assert stopped["state"] == "finished"
                refused = refusal(system, "POST", "/runs", {"record": "jpeg"})
                assert refused is not None
                assert refused.status == 507
                with Recording(file) as recording:
                    frames = recording.frames
                    assert recording.pair(len(frames) - 1) is not None
                    kept.append(full - frames[-1].received)
            record = wait_until("its end is written", partial(finished, system, run), 20.0)
            assert "disk" in record["reason"]
            answer = server.api.get(f"/api/runs/{run}/recording")
            assert answer.content.startswith(b"\x89MCAP")
        # With free space again everything continues.
        begin_run(system)
    tell(
        f"fault 13, disk full: the recording ends within {max(ended):.2f} s, holds all but the "
        f"last {max(kept):.2f} s, zero {1000 * max(zeros):.0f} ms after a stop, a run is stopped "
        f"within {max(stops):.2f} s (worst of {TRIALS})"
    )
    assert max(ended) <= ENDS_S
    assert max(kept) <= 1.0
    assert max(zeros) <= ZERO_S
    assert max(stops) <= ENDS_S
