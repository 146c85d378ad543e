"""A server's clock against the host's, from stamps and arrivals.

What arrives was sent before: ``arrival - stamp`` is the clocks' offset plus a delay that is never
negative, so the clocks' relation is the line below all of these points that comes closest to them.
That line runs through an edge of the lower convex hull, the one above the stamps' mean (Moon,
Skelly, Towsley: "Estimation and removal of clock skew from network delay measurements", 1999).
The smallest delay itself cannot be told from the offset; the alignment finds it in the data.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from observer.errors import TruthError
from observer.geometry import Float64Array

# Below it the delays' scatter passes for a drift.
DRIFT_SPAN_S = 10.0
WINDOW_S = 300.0
# Of arrivals this close together only the quickest tells something.
_BIN_S = 0.1
_FEWEST = 10
_KNOT_S = 60.0
_REFIT_S = 1.0
# Scatter of the quickest arrivals is judged over so many stretches.
_STRETCHES = 8


@dataclass(frozen=True)
class ClockFit:
    """How a server's clock maps to the host's.

    Attributes:
        offset_s: host minus server at ``reference_s``, the smallest delay included.
        drift_ppm: by how much host minus server grows, microseconds a second; positive where the
            server's clock is slow. None where too short a time was seen; it counts as 0 then.
        sigma_s: how far the quickest arrivals of eight stretches scatter about the line.
        samples: arrivals that were taken into account.
        reference_s: the server's time at which ``offset_s`` holds.
        span_s: the time that was seen.
    """

    offset_s: float
    drift_ppm: float | None
    sigma_s: float
    samples: int
    reference_s: float
    span_s: float

    def to_host(self, server_time: float) -> float:
        """The host's monotonic clock, seconds, when the server's showed ``server_time``."""
        drift = (self.drift_ppm or 0.0) * 1e-6
        return server_time + self.offset_s + drift * (server_time - self.reference_s)

    def to_server(self, host_time: float) -> float:
        """The other way round."""
        drift = (self.drift_ppm or 0.0) * 1e-6
        since = host_time - self.offset_s - self.reference_s
        return self.reference_s + since / (1 + drift)


class ClockFitter:
    """Fits a server's clock from samples as they come; no thread, no clock of its own.

    Args:
        window_s: what is older than this is forgotten; a quartz holds its rate for minutes.
    """

    def __init__(self, window_s: float = WINDOW_S) -> None:
        self._window_s = window_s
        # One entry for each bin: arrival and delay-plus-offset of the quickest, and its stamp.
        self._quickest: deque[tuple[int, float, float]] = deque()
        self._counts: deque[int] = deque()
        self._fit: ClockFit | None = None
        self._newest = self._fitted_at = float("-inf")

    def add(self, stamp: float, received: float) -> None:
        """One arrival: the server's stamp and the host's monotonic clock, both seconds."""
        number = int(received // _BIN_S)
        late = received - stamp
        if self._quickest and self._quickest[-1][0] >= number:
            self._counts[-1] += 1
            if late < self._quickest[-1][2]:
                self._quickest[-1] = (self._quickest[-1][0], stamp, late)
        else:
            self._quickest.append((number, stamp, late))
            self._counts.append(1)
            while (number - self._quickest[0][0]) * _BIN_S > self._window_s:
                self._quickest.popleft()
                self._counts.popleft()
        self._newest = received

    def fit(self) -> ClockFit | None:
        """The mapping as far as known; None before a second or so was seen.

        Asked again within a second of arrivals, the answer is the same: nobody can tell them apart,
        and whoever asks often shall not keep arrivals waiting.
        """
        if self._fit is None or self._newest - self._fitted_at >= _REFIT_S:
            self._fitted_at = self._newest
            stamps = np.array([each[1] for each in self._quickest])
            late = np.array([each[2] for each in self._quickest])
            self._fit = _fit(stamps, late, sum(self._counts))
        return self._fit


def host_times(stamps: Float64Array, received: Float64Array) -> Float64Array:
    """A whole recording's server stamps on the host's clock.

    Args:
        stamps: (N,) seconds on the server's clock, of one or several bodies in order of arrival.
        received: (N,) host's monotonic clock, seconds.

    Returns:
        (N,) host's monotonic clock, seconds, too late by the smallest delay. Between windows of
        five minutes the offset goes over linearly, so that a drift that changes is followed.

    Raises:
        TruthError: less than a second was recorded.
    """
    spans = received[-1] - received[0] if len(received) else 0.0
    if spans <= WINDOW_S:
        fit = _known(_fit_of(stamps, received))
        drift = (fit.drift_ppm or 0.0) * 1e-6
        return np.asarray(stamps + fit.offset_s + drift * (stamps - fit.reference_s))
    knots: list[float] = []
    offsets: list[float] = []
    for centre in np.linspace(received[0], received[-1], int(np.ceil(spans / _KNOT_S)) + 1):
        near = np.abs(received - centre) <= WINDOW_S / 2
        fit_there = _fit_of(stamps[near], received[near])
        if fit_there is None:
            continue
        # Where the line is best known: within what was seen.
        seen = stamps[near]
        knot = float(np.clip(centre - fit_there.offset_s, seen.min(), seen.max()))
        if not knots or knot > knots[-1]:
            knots.append(knot)
            offsets.append(fit_there.to_host(knot) - knot)
    if not knots:
        _known(None)
    return np.asarray(stamps + np.interp(stamps, knots, offsets))


def lower_line(x: Float64Array, y: Float64Array) -> tuple[float, float]:
    """The line below all points that comes closest to them.

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


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _known(fit: ClockFit | None) -> ClockFit:
    if fit is None:
        raise TruthError("the recorded motion capture must last a second to relate its clock")
    return fit


def _fit_of(stamps: Float64Array, received: Float64Array) -> ClockFit | None:
    fitter = ClockFitter(float("inf"))
    for stamp, arrival in zip(stamps.tolist(), received.tolist(), strict=True):
        fitter.add(stamp, arrival)
    return fitter.fit()


def _fit(stamps: Float64Array, late: Float64Array, samples: int) -> ClockFit | None:
    if len(stamps) < _FEWEST or np.ptp(stamps) <= 0:
        return None
    span = float(np.ptp(stamps))
    # Stamps may count from 1970: differences keep the digits.
    reference = float(np.mean(stamps))
    since, base = stamps - reference, float(late.min())
    if span < DRIFT_SPAN_S:
        offset, drift = 0.0, None
    else:
        # The mean of ``since`` is 0 but for rounding, so this is the value at the reference.
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
