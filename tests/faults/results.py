"""Measured results, printed and stored in ``artefacts/faults.json``."""

from __future__ import annotations

import json
import math
import statistics
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .bench import TRIALS, tell

RESULTS = Path(__file__).resolve().parents[2] / "artefacts" / "faults.json"


def worst_of(number: int, name: str, once: Callable[[], float], *, within: float) -> None:
    """Repeat a trial, report the worst result, and fail if it exceeds the promise."""
    seconds = [once() for _ in range(TRIALS)]
    worst, middle = max(seconds), statistics.median(seconds)
    tell(
        f"fault {number:2}, {name}: worst of {len(seconds)} {1000 * worst:.0f} ms, "
        f"median {1000 * middle:.0f} ms, allowed {1000 * within:.0f} ms"
    )
    keep(
        number,
        name,
        trials=len(seconds),
        worst_ms=_ms(worst),
        median_ms=_ms(middle),
        allowed_ms=_ms(within),
    )
    told = ", ".join(f"{1000 * each:.0f}" for each in seconds)
    assert worst <= within, f"{name}: {told} ms"


def keep(number: int, name: str, **figures: Any) -> None:
    """Store the figures of a fault, replacing earlier ones."""
    RESULTS.parent.mkdir(exist_ok=True)
    known = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    known[f"{number} {name}"] = figures
    RESULTS.write_text(json.dumps(known, indent=1))


def _ms(seconds: float) -> float | None:
    return round(1000 * seconds, 1) if math.isfinite(seconds) else None
