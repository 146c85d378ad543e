"""How much processor time another process gets."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from app.runtime.processor_time import ProcessorTime

from ..starvation import others_at_work


@contextmanager
def program(text: str) -> Iterator[int]:
    process = subprocess.Popen([sys.executable, "-c", text], stdout=subprocess.PIPE)
    try:
        assert process.stdout is not None
        process.stdout.readline()
        yield process.pid
    finally:
        process.kill()
        process.communicate()


def usable(pid: int, seconds: float, looks: int = 10) -> float:
    """Return for how many of these seconds the process was able to run."""
    processor, found = ProcessorTime(pid), 0.0
    before = time.monotonic()
    for _ in range(looks):
        time.sleep(seconds / looks)
        now = time.monotonic()
        found += processor.could_use(now - before)
        before = now
    return found


SPINS = "print(flush=True)\nwhile True: pass"


def test_a_sleeping_process_could_use_all_the_time() -> None:
    with program("import time; print(flush=True); time.sleep(60)") as pid:
        assert usable(pid, 1.0) > 0.95


def test_a_spinning_process_gets_its_time() -> None:
    with program(SPINS) as pid:
        assert usable(pid, 1.0) > 0.3


@pytest.mark.patient
def test_a_starved_process_could_use_little_time() -> None:
    with program(SPINS) as pid, others_at_work(pid):
        # The first look has no earlier one to compare with.
        assert usable(pid, 3.0, looks=30) < 0.1 + 1.0


def test_a_process_that_is_gone_counts_as_able_to_run() -> None:
    with program(SPINS) as pid:
        processor = ProcessorTime(pid)
        processor.could_use(0.1)
    assert processor.could_use(0.5) == 0.5
    assert os.getpid() != pid
