"""Priority of the drive loop: before everything else, as far as permitted."""

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

# The lowest real-time priority already precedes every ordinary process.
REALTIME = 1
NICENESS = -15
# A thread that computes yields after this long.
_SWITCH_S = 0.001
# capabilities(7): bit of CAP_SYS_NICE.
_SYS_NICE = 23
_MACHINE = Path("/")
# Ticks between two garbage collections: of young objects, and of all.
_YOUNG_TICKS = 50
_ALL_TICKS = 1500


def raise_priority() -> Priority:
    """Take the highest permitted priority; threads started from here on inherit it."""
    if hasattr(os, "sched_setscheduler"):
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(REALTIME))
            return "realtime"
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, NICENESS)
        return "raised"
    return "normal"


def permitted_priority(root: Path = _MACHINE) -> Priority | None:
    """Return the priority that ``raise_priority`` can expect; None where it is unknown.

    It changes nothing and relies on the rights and limits the kernel reports: a kernel that budgets
    real-time by groups of processes may still refuse.

    Args:
        root: root of the file system whose ``proc/self`` to read.
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
    """Leave garbage collection to ``tidy`` and shorten the switch interval of threads.

    Call it when everything is imported: objects existing by then are never scanned again.
    """
    sys.setswitchinterval(_SWITCH_S)
    keep_for_good()
    gc.disable()


def tidy(tick: int) -> None:
    """Collect garbage at the end of a tick, a little at a time."""
    if tick % _ALL_TICKS == 0:
        gc.collect()
    elif tick % _YOUNG_TICKS == 0:
        gc.collect(1)
