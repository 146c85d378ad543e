"""Lateness of the drive loop."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass


@dataclass(frozen=True)
class Lateness:
    """Lateness of the ticks in the window, milliseconds; None before the first tick.

    Lateness counts from a tick's deadline.
    """

    p99_ms: float | None
    max_ms: float | None


class Jitter:
    """Statistics of lateness over the last ``window`` ticks.

    Attributes:
        ticks: number of all ticks so far.
    """

    def __init__(self, window: int = 1500) -> None:
        self._late: deque[float] = deque(maxlen=window)
        self.ticks = 0

    def add(self, late_s: float) -> None:
        """Add a tick that began this long after its deadline."""
        self._late.append(late_s)
        self.ticks += 1

    def lateness(self) -> Lateness:
        """Return the lateness; the percentile by nearest rank."""
        ordered = sorted(self._late)
        if not ordered:
            return Lateness(None, None)
        return Lateness(1000 * ordered[int(0.99 * len(ordered))], 1000 * ordered[-1])
