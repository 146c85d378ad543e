"""Commanded and measured speeds of robots, on the clock of the observed source."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from app.contract.drive import WheelSpeedEvent
from app.contract.robots import WheelSpeed
from app.server.source_time import RisingTimes, SourceInstant

# Two robots at ten samples a second: ten seconds.
_KEPT = 200


@dataclass(frozen=True)
class WheelSample(WheelSpeed):
    """Measured wheel speed.

    Attributes:
        number: counted from 1, without gaps. segment: segment of the preceding frame.
    """

    number: int
    segment: int


class WheelLog:
    """Log of the newest samples; used in the event loop."""

    def __init__(self) -> None:
        self._samples: deque[WheelSample] = deque(maxlen=_KEPT)
        self._rising = RisingTimes()
        self._numbered = 0

    @property
    def newest(self) -> int:
        """Return the number of the newest sample; 0 before the first."""
        return self._numbered

    def take(self, event: WheelSpeedEvent, at: SourceInstant | None) -> WheelSample | None:
        """Store a measurement.

        Return None if the event's values are not finite, if it is not later than the role's last
        one, or while the source's clock is unknown.

        Args:
            at: the event's time on the source's clock, if known.
        """
        if not (math.isfinite(event.time) and math.isfinite(event.sent_mps)):
            return None
        instant = self._rising.of(event.role, at)
        if instant is None:
            return None
        encoder = event.encoder_mps
        self._numbered += 1
        sample = WheelSample(
            number=self._numbered,
            role=event.role,
            time=instant.time,
            segment=instant.segment,
            sent_mps=event.sent_mps,
            encoder_mps=encoder if encoder is not None and math.isfinite(encoder) else None,
        )
        self._samples.append(sample)
        return sample

    def since(self, number: int) -> list[WheelSample]:
        """Return the samples after a number, oldest first."""
        return [sample for sample in self._samples if sample.number > number]
