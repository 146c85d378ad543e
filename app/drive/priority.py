"""Lets the drive loop run before everything else, as far as it is permitted."""

from __future__ import annotations

import contextlib
import gc
import os
import sys
from typing import Literal

Priority = Literal["realtime", "raised", "normal"]

# The lowest of the real-time priorities already goes before every ordinary process.
_REALTIME = 1
_NICENESS = -15
# A thread that computes gives way after this long.
_SWITCH_S = 0.001
# Ticks between two collections of younger and of all objects.
_YOUNG_TICKS = 50
_ALL_TICKS = 1500


def raise_priority() -> Priority:
    """Take the highest priority that is permitted; threads started from here on have it too."""
    if hasattr(os, "sched_setscheduler"):
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(_REALTIME))
            return "realtime"
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, _NICENESS)
        return "raised"
    return "normal"


def calm_interpreter() -> None:
    """No garbage collection but by ``tidy``, and quick changes between threads.

    Call it when everything is imported: what is there by now is never looked through again.
    """
    sys.setswitchinterval(_SWITCH_S)
    gc.collect()
    gc.freeze()
    gc.disable()


def tidy(tick: int) -> None:
    """Collect garbage, at the end of a tick and little at a time."""
    if tick % _ALL_TICKS == 0:
        gc.collect()
    elif tick % _YOUNG_TICKS == 0:
        gc.collect(1)
