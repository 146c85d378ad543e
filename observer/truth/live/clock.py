"""Relation of a server's clock to the host's, from stamps and arrival times.

``arrival - stamp`` is the clocks' offset plus a delay that is never negative, so the clocks'
relation is the line below all of these points that comes closest to them.
That line runs through an edge of the lower convex hull, the one above the stamps' mean (Moon,
Skelly, Towsley: "Estimation and removal of clock skew from network delay measurements", 1999).
The smallest delay cannot be separated from the offset; the alignment finds it in the data.

A single arrival that is impossibly early, because its stamp is wrong, would pull that line down. So
an arrival that is by far the quickest of its seconds, with none near it, is left out.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array

# Seconds: over a shorter time the scatter of the delays looks like a drift.
DRIFT_SPAN_S = 10.0
WINDOW_S = 300.0
# Seconds: of arrivals this close together only the quickest is informative.
_BIN_S = 0.1
_FEWEST = 10
_REFIT_S = 1.0
# In this many bins there is normally a second arrival about as quick as the quickest.
_BINS_TOGETHER = 50
# The quickest is alone if the second comes more than this many seconds later, and by more than this
# many times the median lateness relative to the second.
_ALONE_S, _ALONE_TIMES = 0.001, 3.0
# Number of stretches over which the scatter of the quickest arrivals is judged.
_STRETCHES = 8


@dataclass(frozen=True)
class ClockFit:
    """Mapping of a server's clock to the host's.

    Attributes:
        offset_s: host minus server at ``reference_s``, including the smallest delay.
        drift_ppm: growth of host minus server, microseconds per second; positive if the server's
            clock is slow. None if the time span is too short; it then counts as 0.
        sigma_s: scatter about the line of the quickest arrivals of eight stretches.
        samples: number of arrivals taken into account.
        reference_s: the server's time at which ``offset_s`` holds.
        span_s: the time span of the arrivals.
    """

    offset_s: float
    drift_ppm: float | None
    sigma_s: float
    samples: int
    reference_s: float
    span_s: float

    def to_host(self, server_time: float) -> float:
        """Convert the server's time to the host's monotonic clock, seconds."""
        drift = (self.drift_ppm or 0.0) * 1e-6
        return server_time + self.offset_s + drift * (server_time - self.reference_s)

    def to_server(self, host_time: float) -> float:
        """Convert the host's monotonic clock to the server's time, seconds."""
        drift = (self.drift_ppm or 0.0) * 1e-6
        since = host_time - self.offset_s - self.reference_s
        return self.reference_s + since / (1 + drift)


class ClockFitter:
    """Fits a server's clock from samples as they arrive; it has no thread and reads no clock.

    Args:
        window_s: older samples are forgotten; a quartz keeps its rate for minutes.
    """

    def __init__(self, window_s: float = WINDOW_S) -> None:
        self._window_s = window_s
        # For each bin: its number, the quickest's stamp and delay plus offset, number of arrivals.
        self._quickest: deque[tuple[int, float, float, int]] = deque()
        self._fit: ClockFit | None = None
        self._newest = self._fitted_at = float("-inf")

    def add(self, stamp: float, received: float) -> None:
        """Add an arrival: the server's stamp and the host's monotonic clock, both seconds."""
        number = int(received // _BIN_S)
        late = received - stamp
        if self._quickest and self._quickest[-1][0] >= number:
            number, quickest, least, count = self._quickest[-1]
            if late < least:
                quickest, least = stamp, late
            self._quickest[-1] = (number, quickest, least, count + 1)
        else:
            self._quickest.append((number, stamp, late, 1))
            while (number - self._quickest[0][0]) * _BIN_S > self._window_s:
                self._quickest.popleft()
        self._newest = received

    def fit(self) -> ClockFit | None:
        """Return the mapping as far as known; None before about a second of arrivals.

        It is refitted at most once per second, so that frequent calls do not delay arrivals.
        """
        if self._fit is None or self._newest - self._fitted_at >= _REFIT_S:
            self._fitted_at = self._newest
            stamps = np.array([each[1] for each in self._quickest])
            late = np.array([each[2] for each in self._quickest])
            self._fit = _fit(stamps, late, sum(each[3] for each in self._quickest))
        return self._fit


def lower_line(x: Float64Array, y: Float64Array) -> tuple[float, float]:
    """Return the line below all points that comes closest to them.

    Args:
        x, y: (N,), at least two different ``x``.

    Returns:
        Its value at the mean of ``x``, and its slope.
    """
    hull: list[tuple[float, float]] = []
    for index in np.lexsort((y, x)):
        point = (float(x[index]), float(y[index]))
        if hull and hull[-1][0] == point[0]:
            continue
        while len(hull) > 1 and _turn(hull[-2], hull[-1], point) <= 0:
            hull.pop()
        hull.append(point)
    middle = float(np.mean(x))
    for (x0, y0), (x1, y1) in pairwise(hull):
        if middle <= x1:
            slope = (y1 - y0) / (x1 - x0)
            return y0 + slope * (middle - x0), slope
    raise ValueError("a line needs points at two different places at least")


def not_alone(late: Float64Array) -> NDArray[np.bool_]:
    """Mark the arrivals whose lateness others confirm: all but a quickest one that is alone.

    Args:
        late: (N,) seconds, any offset, of arrivals close to each other in time.

    Returns:
        (N,), at most one of them False.
    """
    confirmed = np.ones(len(late), np.bool_)
    if len(late) >= _FEWEST:
        first, second = np.argpartition(late, 1)[:2]
        usual = float(np.median(late)) - float(late[second])
        if late[second] - late[first] > max(_ALONE_S, _ALONE_TIMES * usual):
            confirmed[first] = False
    return confirmed


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _fit(stamps: Float64Array, late: Float64Array, samples: int) -> ClockFit | None:
    parts = np.array_split(late, max(1, len(late) // _BINS_TOGETHER))
    confirmed = np.concatenate([not_alone(part) for part in parts])
    stamps, late = stamps[confirmed], late[confirmed]
    if len(stamps) < _FEWEST or np.ptp(stamps) <= 0:
        return None
    span = float(np.ptp(stamps))
    # Stamps may count from 1970: use differences to keep precision.
    reference = float(np.mean(stamps))
    since, base = stamps - reference, float(late.min())
    if span < DRIFT_SPAN_S:
        offset, drift = 0.0, None
    else:
        # The mean of ``since`` is 0 up to rounding, so this is the value at the reference.
        offset, drift = lower_line(since, late - base)
    above = (late - base) - offset - (drift or 0.0) * since
    stretches = np.array_split(above[np.argsort(since)], _STRETCHES)
    minima = np.array([each.min() for each in stretches if len(each)])
    return ClockFit(
        offset_s=base + offset,
        drift_ppm=None if drift is None else drift * 1e6,
        sigma_s=float(np.sqrt(np.mean(minima**2))),
        samples=samples,
        reference_s=reference,
        span_s=span,
    )
