"""The worker as a process: what it remembers, and what happens when it is lost."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import psutil
import pytest

from app.workers.alignment.messages import Choices, Solve
from app.workers.alignment.process import AlignmentWorker
from app.workers.alignment.work import Aligner
from observer.truth.alignment.live_clocks import LiveClocks
from observer.truth.alignment.result import Alignment
from observer.truth.live.clock import ClockFit
from observer.truth.motion_capture import Trajectory

from ....observer.truth.alignment.conftest import MOUNT, make_room

SAME = ClockFit(0.0, 0.0, 0.0, 1, 0.0, 1.0)
CLOCKS = LiveClocks(SAME, SAME)
ROOM = make_room(1)


def job(begin: float, end: float, choices: Choices | None = None, *, anew: bool = False) -> Solve:
    """Return a job with the data of the room from that time."""
    lines = tuple(line for line in ROOM.lines if begin <= line["time"] < end)
    samples = []
    for name, body in ROOM.capture.bodies.items():
        some = (body.times >= begin - 1) & (body.times < end)
        assert body.rotations is not None
        samples.append(
            Trajectory(name, body.times[some], body.positions[some], body.rotations[some])
        )
    return Solve(anew, lines, tuple(samples), CLOCKS, choices or Choices(mount=MOUNT))


@pytest.fixture
def worker() -> Iterator[AlignmentWorker]:
    made = AlignmentWorker()
    yield made
    made.close()


def children() -> list[psutil.Process]:
    return [
        child
        for child in psutil.Process().children()
        if "app.workers.alignment" in " ".join(child.cmdline())
    ]


def test_the_worker_keeps_its_state_until_lost_and_then_starts_over(
    worker: AlignmentWorker,
) -> None:
    first = worker.solve(job(0, 4))
    assert first is not None
    assert isinstance(first.state, str)
    assert first.state.startswith("not aligned yet: ")
    second = worker.solve(job(4, 18))
    assert second is not None
    assert isinstance(second.state, Alignment)
    assert second.state.time.offset_s == pytest.approx(0.3, abs=0.03)
    assert second.state.roles == {"Amigo": "observer", "P3DX": "obstacle"}
    # Robots and pages have priority.
    (process,) = children()
    assert process.nice() >= 15
    process.kill()
    assert worker.solve(job(18, 20)) is None
    third = worker.solve(job(20, 21))
    assert third is not None
    assert isinstance(third.state, str), "what came before is forgotten"
    ending = threading.Timer(0.05, worker.end)
    ending.start()
    began = time.monotonic()
    while worker.solve(job(21, 26, anew=True)) is not None:
        assert time.monotonic() - began < 20
    ending.join()
    assert worker.solve(job(0, 4)) is None
    assert children() == []


def test_ignored_bodies_need_not_exist() -> None:
    aligner = Aligner()
    told = aligner.solve(job(0, 18, Choices(ignore=("P3DX", "hat"), mount=MOUNT)))
    assert isinstance(told.state, Alignment)
    assert told.state.roles == {"Amigo": "observer"}
    # A changed choice applies from the next solution on.
    told = aligner.solve(job(18, 26, Choices(observer="nobody")))
    assert isinstance(told.state, Alignment), "what was found stays as long as nothing better is"
    told = aligner.solve(replace(job(0, 26, Choices(observer="nobody")), anew=True))
    assert isinstance(told.state, str)
    assert "no body 'nobody'" in told.state
    assert np.isfinite(told.seconds)
