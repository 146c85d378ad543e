"""Memory freed by one thread is reused by others, instead of growing with their number."""

from __future__ import annotations

import subprocess
import sys

import pytest

PREPARED = """
import threading
import numpy as np
from app.runtime.heap import keep_freed_memory, return_freed_memory
keep_freed_memory()
def kept():
    for line in open("/proc/self/smaps_rollup"):
        if line.startswith("Anonymous:"):
            return int(line.split()[1]) / 1024
before = kept()
"""
# Sixteen threads in turn hold 6 MB for a moment; prints the MiB that are kept.
SHARED = """
meet = threading.Barrier(16)
turn = threading.Lock()
def one_by_one():
    meet.wait(20)
    with turn:
        pictures = [np.ones(60_000, np.uint8) for _ in range(100)]
        del pictures
    meet.wait(20)
threads = [threading.Thread(target=one_by_one) for _ in range(16)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join(20)
print(kept() - before)
"""
# Small blocks stay between large freed ones; prints the MiB that are kept before and after.
RETURNED = """
held = [(np.ones(200_000, np.uint8), np.ones(200, np.uint8)) for _ in range(400)]
held = [small for _, small in held]
left = kept() - before
return_freed_memory()
print(left, kept() - before)
"""


def told(program: str) -> list[float]:
    command = [sys.executable, "-c", PREPARED + program]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    return [float(number) for number in ended.stdout.split()]


@pytest.mark.skipif(sys.platform != "linux", reason="the memory is read from /proc")
def test_memory_freed_by_threads_is_shared() -> None:
    (kept,) = told(SHARED)
    assert kept < 30


@pytest.mark.skipif(sys.platform != "linux", reason="the memory is read from /proc")
def test_free_memory_between_live_blocks_is_returned() -> None:
    left, kept = told(RETURNED)
    assert left > 60
    assert kept < 10
