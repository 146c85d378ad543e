"""Figures of a measured stop for display."""

from __future__ import annotations

import math

from app.contract.drive import StoppedEvent
from app.contract.robots import StopMeasured


def stop_figures(event: StoppedEvent) -> StopMeasured:
    """Return the figures of a stop, rounded to meaningful digits: 0.1 ms and 1 mm."""

    def since_cause(moment: float | None) -> float | None:
        return None if moment is None else _rounded(1e3 * (moment - event.cause_time), 1)

    return StopMeasured(
        since_cause(event.zero_time),
        since_cause(event.stood_time),
        _rounded(event.distance_m, 3),
        _rounded(event.speed_mps, 3),
        _rounded(event.separation_m, 3),
    )


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None or not math.isfinite(value) else round(value, digits)
