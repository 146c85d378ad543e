"""Workers that do job after job: if one is lost, stuck or cannot start, the next job is done."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

import app.runtime.worker as worker_module
from app.runtime.worker import JobFailed, LastingWorker, Worker

LONGEST_S = 2.5
ECHO = "from app.runtime.jobs import do_jobs\n\ndo_jobs(lambda job, _: job)\n"
COUNTING = """
import time
from app.runtime.jobs import do_jobs


def count(job, report):
    for done in range(job):
        report("counting", done / job)
        time.sleep(0.02)
    return job


do_jobs(count)
"""
# More than a pipe holds.
LARGE = b"x" * 1_000_000


@pytest.fixture
def echo(tmp_path: Path, repository: Path) -> Iterator[LastingWorker]:
    """A worker whose results are its jobs."""
    (tmp_path / "echo.py").write_text(ECHO)
    paths = os.pathsep.join((str(repository), str(tmp_path)))
    made = LastingWorker(Worker("echo", 5, {"PYTHONPATH": paths}), longest_s=LONGEST_S)
    yield made
    made.close()
    assert psutil.Process().children() == []


def process() -> psutil.Process:
    (child,) = psutil.Process().children()
    return child


def test_a_killed_worker_is_logged_and_replaced(
    echo: LastingWorker, caplog: pytest.LogCaptureFixture
) -> None:
    assert echo.do(LARGE, bytes) == LARGE
    first = process()
    assert echo.do("again", str) == "again"
    assert process() == first
    first.kill()
    assert echo.do(LARGE, bytes) is None
    assert [record.getMessage() for record in caplog.records] == [
        "echo was lost: it ended by SIGKILL; the next job starts it again"
    ]
    assert echo.do(LARGE, bytes) == LARGE
    assert process() != first


# With LARGE it hangs while the job is written, with small while the answer is awaited.
@pytest.mark.parametrize("job", [LARGE, b"small"])
def test_a_suspended_worker_is_given_up(echo: LastingWorker, job: bytes) -> None:
    assert echo.do(job, bytes) == job
    process().suspend()
    began = time.monotonic()
    assert echo.do(job, bytes) is None
    assert time.monotonic() - began < LONGEST_S + 2.0
    assert psutil.Process().children() == []
    assert echo.do(job, bytes) == job


def test_a_worker_that_cannot_be_started_is_logged(
    echo: LastingWorker, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(worker_module, "_COMMAND", ("/no/such/python",))
        assert echo.do("a job", str) is None
    assert "echo cannot be used: [Errno 2] No such file" in caplog.text
    assert echo.do("a job", str) == "a job"


def test_an_ended_worker_is_not_replaced(
    echo: LastingWorker, caplog: pytest.LogCaptureFixture
) -> None:
    assert echo.do("a job", str) == "a job"
    echo.end()
    assert echo.do("a job", str) is None
    # An intended end is not logged.
    assert caplog.records == []


async def test_a_job_pauses_while_it_is_held(tmp_path: Path, repository: Path) -> None:
    (tmp_path / "counting.py").write_text(COUNTING)
    paths = os.pathsep.join((str(repository), str(tmp_path)))
    heard: list[float] = []
    held = [False]
    worker = Worker("counting", 5, {"PYTHONPATH": paths})
    async with asyncio.timeout(30):
        doing = asyncio.create_task(
            worker.do(60, lambda told: heard.append(told.share), held=lambda: held[0])
        )
        while len(heard) < 3:
            await asyncio.sleep(0.01)
        held[0] = True
        while process().status() != psutil.STATUS_STOPPED:
            await asyncio.sleep(0.01)
        await asyncio.sleep(0.1)
        before = len(heard)
        await asyncio.sleep(0.4)
        assert len(heard) == before
        held[0] = False
        assert await doing == 60
    assert len(heard) == 60


async def test_a_held_job_can_be_cancelled(tmp_path: Path, repository: Path) -> None:
    (tmp_path / "counting.py").write_text(COUNTING)
    paths = os.pathsep.join((str(repository), str(tmp_path)))
    worker = Worker("counting", 5, {"PYTHONPATH": paths})
    async with asyncio.timeout(30):
        doing = asyncio.create_task(worker.do(60, lambda _: None, held=lambda: True))
        while not (found := psutil.Process().children()) or (
            found[0].status() != psutil.STATUS_STOPPED
        ):
            await asyncio.sleep(0.01)
        doing.cancel()
        with pytest.raises(asyncio.CancelledError):
            await doing
    assert psutil.Process().children() == []


async def test_a_job_ends_if_it_is_unknown_whether_it_is_held(
    tmp_path: Path, repository: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "counting.py").write_text(COUNTING)
    paths = os.pathsep.join((str(repository), str(tmp_path)))
    worker = Worker("counting", 5, {"PYTHONPATH": paths})
    answers = iter([True])

    def held() -> bool:
        try:
            return next(answers)
        except StopIteration:
            raise ValueError("on purpose") from None

    async with asyncio.timeout(30):
        with pytest.raises(JobFailed, match="whether it must pause"):
            await worker.do(60, lambda _: None, held=held)
    assert "on purpose" in caplog.text
    assert psutil.Process().children() == []
