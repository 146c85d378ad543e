"""What threads have freed is used again by others, instead of adding up with their number."""

from __future__ import annotations

import subprocess
import sys

import pytest

# Of sixteen threads each holds 6 MB for a moment, one after another; prints the MiB that are kept.
KEPT = """
import threading
import numpy as np
from app.runtime.heap import keep_freed_memory
keep_freed_memory()
meet = threading.Barrier(16)
def kept():
    for line in open("/proc/self/smaps_rollup"):
        if line.startswith("Anonymous:"):
            return int(line.split()[1]) / 1024
before = kept()
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


@pytest.mark.skipif(sys.platform != "linux", reason="the memory is read from /proc")
def test_threads_share_what_they_have_freed() -> None:
    command = [sys.executable, "-c", KEPT]
    told = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert float(told.stdout) < 30
