"""How late the loop is."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass


@dataclass(frozen=True)
class Lateness:
    """Of the ticks in the window, milliseconds behind their deadlines; None before the first."""

    p50_ms: float | None
    p99_ms: float | None
    max_ms: float | None


class Jitter:
    """Lateness over the last ``window`` ticks.

    Attributes:
        ticks: all so far.
    """

    def __init__(self, window: int = 1500) -> None:
        self._late: deque[float] = deque(maxlen=window)
        self.ticks = 0

    def add(self, late_s: float) -> None:
        """One more tick began so long behind its deadline."""
        self._late.append(late_s)
        self.ticks += 1

    def lateness(self) -> Lateness:
        """Nearest-rank percentiles."""
        ordered = sorted(self._late)
        if not ordered:
            return Lateness(None, None, None)

        def percentile(share: float) -> float:
            return 1000 * ordered[min(len(ordered) - 1, int(share * len(ordered)))]

        return Lateness(percentile(0.5), percentile(0.99), 1000 * ordered[-1])
