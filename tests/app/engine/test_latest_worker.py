"""The thread that works only on the latest job."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from itertools import pairwise

import pytest

from app.engine.latest_worker import LatestWorker

PATIENCE_S = 10.0


class Bench:
    """A worker whose work waits for permission to go on."""

    def __init__(self, rate_hz: float) -> None:
        self.began: list[tuple[int, float]] = []
        self.gate = threading.Event()
        self.gate.set()
        self._changed = threading.Condition()
        self.worker: LatestWorker[int] = LatestWorker("bench", self._work, rate_hz=rate_hz)

    def _work(self, job: int) -> None:
        with self._changed:
            self.began.append((job, time.monotonic()))
            self._changed.notify_all()
        assert self.gate.wait(PATIENCE_S)

    def wait_for(self, job: int) -> None:
        with self._changed:
            assert self._changed.wait_for(lambda: job in self.jobs, PATIENCE_S), self.jobs

    @property
    def jobs(self) -> list[int]:
        return [job for job, _ in self.began]


@pytest.fixture
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    made = Bench(getattr(request, "param", 1000.0))
    yield made
    made.gate.set()
    made.worker.close()


def test_only_the_newest_waiting_job_is_done(bench: Bench) -> None:
    bench.gate.clear()
    bench.worker.give(1)
    bench.wait_for(1)
    for job in range(2, 9):
        bench.worker.give(job)
    bench.gate.set()
    bench.wait_for(8)
    assert bench.jobs == [1, 8]


@pytest.mark.parametrize("bench", [20.0], indirect=True)
def test_the_rate_is_kept_however_often_jobs_are_given(bench: Bench) -> None:
    begin = time.monotonic()
    job = 0
    while time.monotonic() - begin < 1.0:
        bench.worker.give(job := job + 1)
        time.sleep(0.004)
    # 20 are intended; a busy machine may delay some, but none may come earlier.
    assert 10 <= len(bench.began) <= 21
    assert job > 3 * len(bench.began)


def test_costly_jobs_run_less_often() -> None:
    """Jobs of 20 ms may take at most a quarter of the time: one every 80 ms."""
    began: list[float] = []

    def work(_: int) -> None:
        began.append(time.monotonic())
        end = time.thread_time() + 0.02
        while time.thread_time() < end:
            pass

    worker: LatestWorker[int] = LatestWorker("costly", work, rate_hz=1000.0, most_share=0.25)
    deadline = time.monotonic() + 1.0
    while time.monotonic() < deadline:
        worker.give(0)
        time.sleep(0.004)
    worker.close()
    assert len(began) >= 3
    assert all(later - before >= 0.075 for before, later in pairwise(began))


def test_a_forgotten_job_is_not_done(bench: Bench) -> None:
    bench.gate.clear()
    bench.worker.give(1)
    bench.wait_for(1)
    bench.worker.give(2)
    bench.worker.forget()
    bench.gate.set()
    time.sleep(0.05)
    bench.worker.give(3)
    bench.wait_for(3)
    assert bench.jobs == [1, 3]


def test_closing_ends_the_thread_and_ignores_later_jobs(bench: Bench) -> None:
    bench.worker.give(1)
    bench.wait_for(1)
    assert "bench" in {thread.name for thread in threading.enumerate()}
    bench.worker.close()
    assert "bench" not in {thread.name for thread in threading.enumerate()}
    bench.worker.give(2)
    bench.worker.close()
    assert bench.jobs == [1]
