"""Lets the drive loop run before everything else, as far as it is permitted."""

from __future__ import annotations

import contextlib
import gc
import math
import os
import re
import sys
from pathlib import Path
from typing import Literal

from app.runtime.heap import keep_for_good

Priority = Literal["realtime", "raised", "normal"]

# The lowest of the real-time priorities already goes before every ordinary process.
REALTIME = 1
NICENESS = -15
# A thread that computes gives way after this long.
_SWITCH_S = 0.001
# capabilities(7): bit of CAP_SYS_NICE.
_SYS_NICE = 23
_MACHINE = Path("/")
# Ticks between two collections of younger and of all objects.
_YOUNG_TICKS = 50
_ALL_TICKS = 1500


def raise_priority() -> Priority:
    """Take the highest priority that is permitted; threads started from here on have it too."""
    if hasattr(os, "sched_setscheduler"):
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(REALTIME))
            return "realtime"
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, NICENESS)
        return "raised"
    return "normal"


def permitted_priority(root: Path = _MACHINE) -> Priority | None:
    """What ``raise_priority`` may be expected to reach; None where it cannot be told.

    Changes nothing, so it is by what the kernel says of rights and limits: a kernel that divides
    real-time by groups of processes may refuse all the same.

    Args:
        root: of the file system in whose ``proc/self`` to look.
    """
    try:
        status = (root / "proc" / "self" / "status").read_text(encoding="utf-8")
        limits = (root / "proc" / "self" / "limits").read_text(encoding="utf-8")
    except OSError:
        return None
    rights = re.search(r"^CapEff:\s*([0-9a-f]+)", status, re.MULTILINE)
    if rights is not None and int(rights[1], 16) >> _SYS_NICE & 1:
        return "realtime"
    if _limit(limits, "Max realtime priority") >= REALTIME:
        return "realtime"
    # getrlimit(2): niceness down to 20 - limit.
    return "raised" if _limit(limits, "Max nice priority") >= 20 - NICENESS else "normal"


def _limit(limits: str, name: str) -> float:
    found = re.search(rf"^{name} +(\d+|unlimited)", limits, re.MULTILINE)
    if found is None:
        return 0
    return math.inf if found[1] == "unlimited" else int(found[1])


def calm_interpreter() -> None:
    """No garbage collection but by ``tidy``, and quick changes between threads.

    Call it when everything is imported: what is there by now is never looked through again.
    """
    sys.setswitchinterval(_SWITCH_S)
    keep_for_good()
    gc.disable()


def tidy(tick: int) -> None:
    """Collect garbage, at the end of a tick and little at a time."""
    if tick % _ALL_TICKS == 0:
        gc.collect()
    elif tick % _YOUNG_TICKS == 0:
        gc.collect(1)
