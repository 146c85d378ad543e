"""A measured stop in the figures that people are shown."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from app.drive.messages import StoppedEvent


@dataclass(frozen=True)
class StopFigures:
    """See ``app.drive.messages.StoppedEvent``; None is not known.

    Attributes:
        zero_ms, stood_ms: from the cause until zero went out, and until it stood.
    """

    zero_ms: float | None
    stood_ms: float | None
    distance_m: float | None
    speed_mps: float | None
    separation_m: float | None

    @staticmethod
    def of(event: StoppedEvent) -> StopFigures:
        """Rounded to what can be told apart: 0.1 ms and 1 mm."""

        def since_cause(moment: float | None) -> float | None:
            return None if moment is None else _rounded(1e3 * (moment - event.cause_time), 1)

        return StopFigures(
            since_cause(event.zero_time),
            since_cause(event.stood_time),
            _rounded(event.distance_m, 3),
            _rounded(event.speed_mps, 3),
            _rounded(event.separation_m, 3),
        )

    def facts(self) -> dict[str, Any]:
        """As plain values, for JSON."""
        return asdict(self)


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None or not math.isfinite(value) else round(value, digits)
