"""Figures of the running loop: rates, timings, latency, losses; callers pass in the time."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from statistics import median

from app.contract.events import DenseStereoEvent, ObservationEvent, SkippedFrameEvent
from app.contract.status import DenseStereoStatus, LatencyStatus, SkippedFrame

_RATE_WINDOW_S = 2.0
_TIMED_FRAMES = 90
_LATENCY_SAMPLES = 600
_SKIPPED_SHOWN = 5


class Telemetry:
    """Collector of the recent figures that ``status`` shows."""

    def __init__(self) -> None:
        self._arrivals: deque[float] = deque()
        self._timings: deque[dict[str, float]] = deque(maxlen=_TIMED_FRAMES)
        self._latency: deque[float] = deque(maxlen=_LATENCY_SAMPLES)
        self._skipped: deque[SkippedFrame] = deque(maxlen=_SKIPPED_SHOWN)
        self._dense: deque[tuple[float, DenseStereoEvent]] = deque()
        self._newest_dense: DenseStereoEvent | None = None
        self._last: tuple[int, int] | None = None
        self._observed_before = 0
        self._observed_now = 0
        self.frame_skips = 0
        self.live_messages_dropped = 0
        self.dense_trouble: str | None = None

    @property
    def frames_observed(self) -> int:
        """Return the number of frames observed by all engines, including lost messages."""
        return self._observed_before + self._observed_now

    @property
    def skipped(self) -> list[SkippedFrame]:
        """Return the last skipped frames, oldest first."""
        return list(self._skipped)

    def new_engine(self) -> None:
        """Handle a new engine, which counts from 0 again."""
        self._observed_before += self._observed_now
        self._observed_now = 0
        self._last = None

    def new_source(self) -> None:
        """Discard the figures of the previous source."""
        self._arrivals.clear()
        self._timings.clear()
        self._skipped.clear()
        self._latency.clear()
        self._dense.clear()
        self._newest_dense = self.dense_trouble = None
        self._last = None
        self.frame_skips = 0

    def observed(self, event: ObservationEvent, now: float) -> None:
        """Count one observation; a frame observed twice counts once."""
        self._observed_now = max(self._observed_now, event.sequence + 1)
        self.frame_skips = event.frame_skips
        unique = (event.line["segment"], event.line["frame"])
        if unique != self._last:
            self._last = unique
            self._arrivals.append(now)
        self._timings.append(event.line["timings_ms"])

    def dense_made(self, event: DenseStereoEvent, now: float) -> bool:
        """Count a cloud or disparity view, or its failure; return whether the trouble changed."""
        changed = event.trouble != self.dense_trouble
        self.dense_trouble = event.trouble
        if event.trouble is None:
            self._newest_dense = event
            self._dense.append((now, event))
        return changed

    def dense(self, now: float) -> DenseStereoStatus:
        """Return rate and cost over the last 2 s, and the age of the newest result."""
        while self._dense and self._dense[0][0] < now - _RATE_WINDOW_S:
            self._dense.popleft()
        newest, lately = self._newest_dense, [event for _, event in self._dense]
        return DenseStereoStatus(
            per_s=_per_second([arrival for arrival, _ in self._dense], now),
            age_s=None if newest is None else round(max(0.0, now - newest.received), 3),
            median_ms=round(1e3 * median(e.seconds for e in lately), 1) if lately else None,
            coarseness=None if newest is None else newest.coarseness,
        )

    def frame_skipped(self, event: SkippedFrameEvent) -> None:
        self._skipped.append(event)

    def painted(self, latency_s: float) -> None:
        """Store the latency of an observation that a page has painted and acknowledged."""
        self._latency.append(1000.0 * latency_s)

    def rate(self, now: float) -> float:
        """Return the unique frames per second over the last 2 s."""
        while self._arrivals and self._arrivals[0] < now - _RATE_WINDOW_S:
            self._arrivals.popleft()
        return _per_second(self._arrivals, now)

    @property
    def timings_ms(self) -> dict[str, float]:
        """Return the median time of each stage over the last frames, in the newest one's order."""
        stages = list(self._timings[-1]) if self._timings else []
        return {
            stage: round(median(t[stage] for t in self._timings if stage in t), 3)
            for stage in stages
        }

    @property
    def latency(self) -> LatencyStatus:
        values = sorted(self._latency)
        if not values:
            return LatencyStatus(None, None, 0)
        return LatencyStatus(
            round(median(values), 1), round(_percentile(values, 0.95), 1), len(values)
        )


def _per_second(arrivals: Sequence[float], now: float) -> float:
    if len(arrivals) < 2:
        return 0.0
    # Count intervals, not arrivals: the first arrival only starts the clock.
    return (len(arrivals) - 1) / max(now - arrivals[0], 1e-3)


def _percentile(ordered: list[float], share: float) -> float:
    """Return the smallest value not below the given share of all (nearest rank)."""
    return ordered[min(math.ceil(share * len(ordered)), len(ordered)) - 1]
