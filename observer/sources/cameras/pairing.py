"""Pairing of left and right images by their time stamps."""

from __future__ import annotations

import statistics
import threading
from collections import deque
from typing import Literal

_WINDOW_S = 5.0
_ENOUGH = 10


def judge(left: float, right: float, period: float) -> Literal["pair", "drop left", "drop right"]:
    """Decide what to do with two images.

    If they are more than half a period apart, the older one's real partner did not come, and the
    newer one may still get its own.

    Args:
        left, right: their stamps, seconds of one clock. period: from frame to frame, seconds.
    """
    if abs(left - right) <= 0.5 * period:
        return "pair"
    return "drop left" if left < right else "drop right"


class Skews:
    """Time between the images of a pair over the last seconds; safe for any thread."""

    def __init__(self) -> None:
        self._skews: deque[tuple[float, float]] = deque()
        self._lock = threading.Lock()

    def add(self, time: float, skew: float) -> None:
        """Take the skew of the pair at this time, seconds."""
        with self._lock:
            self._skews.append((time, abs(skew)))
            while self._skews[0][0] < time - _WINDOW_S:
                self._skews.popleft()

    def median_and_p95(self) -> tuple[float | None, float | None]:
        """Return median and 95th percentile, seconds; None before enough pairs."""
        with self._lock:
            skews = [skew for _, skew in self._skews]
        if len(skews) < _ENOUGH:
            return None, None
        return statistics.median(skews), statistics.quantiles(skews, n=20, method="inclusive")[-1]
