"""Live clocks of motion capture and of the source, each relative to the host's.

Both are known up to the smallest latency; the alignment estimates the rest.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from observer.geometry import Float64Array
from observer.truth.live.clock import ClockFit, ClockFitter

# Seconds: frames this much earlier or later than their times predict are on another clock.
_ANOTHER_S = 0.3
# Seconds: a source that only stalls catches up within this time.
_LATE_FOR_S = 2.0


@dataclass(frozen=True)
class LiveClocks:
    """Conversion of motion capture's stamps to the source's clock, as far as arrivals tell.

    Attributes:
        server: from motion capture's clock to the host's. source: from the frames' clock to it.
    """

    server: ClockFit
    source: ClockFit

    def to_source(self, stamps: Float64Array) -> Float64Array:
        """Convert stamps (N,) to the source's clock, seconds."""
        since = np.asarray(stamps, np.float64) - self.server.reference_s
        at = self.source.to_server(self.server.to_host(self.server.reference_s))
        return np.asarray(at + self._slope * since)

    def to_server(self, times: Float64Array) -> Float64Array:
        """Convert the source's times (N,) to stamps, seconds."""
        at = self.source.to_server(self.server.to_host(self.server.reference_s))
        since = (np.asarray(times, np.float64) - at) / self._slope
        return np.asarray(self.server.reference_s + since)

    @property
    def _slope(self) -> float:
        """Seconds of the source per second of the server."""
        server, source = (1 + 1e-6 * (fit.drift_ppm or 0.0) for fit in (self.server, self.source))
        return server / source


class SourceClock:
    """Fits the frames' clock to the host's; it reads no clock itself."""

    def __init__(self) -> None:
        self._begin()

    def _begin(self) -> None:
        self._fitter = ClockFitter()
        self._last: float | None = None
        # Arrival, and delay relative to the expected arrival.
        self._lately: deque[tuple[float, float]] = deque()

    def add(self, time: float, received: float) -> bool:
        """Add a frame: its time on the source's clock, and its arrival on the host's.

        Returns:
            True if a new clock begins here, because the source was paused, changed its pace or
            restarted. What was known is then forgotten.
        """
        another = self._is_another(time, received)
        if another:
            self._begin()
        self._fitter.add(time, received)
        self._last = time
        return another

    def fit(self) -> ClockFit | None:
        """Return the fit of the source's clock to the host's; None before about a second."""
        return self._fitter.fit()

    def _is_another(self, time: float, received: float) -> bool:
        if self._last is not None and time < self._last:
            return True
        fit = self._fitter.fit()
        if fit is None:
            return False
        late = received - fit.to_host(time)
        if late < -_ANOTHER_S:
            return True
        self._lately.append((received, late))
        while received - self._lately[0][0] > _LATE_FOR_S:
            self._lately.popleft()
        waited = received - self._lately[0][0] > 0.8 * _LATE_FOR_S
        return waited and min(each[1] for each in self._lately) > _ANOTHER_S
