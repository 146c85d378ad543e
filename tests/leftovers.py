"""Processes that outlive single tests, but not the tests that share them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import psutil

_GRACE_S = 3.0


@contextmanager
def no_process_left_behind() -> Iterator[None]:
    """Fail if a process started within is not gone a moment afterwards."""
    before = set(psutil.Process().children(recursive=True))
    yield
    left = [each for each in psutil.Process().children(recursive=True) if each not in before]
    _, alive = psutil.wait_procs(left, _GRACE_S)
    for process in alive:
        process.kill()
    assert not alive, f"left behind: {alive}"
