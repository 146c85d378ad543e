"""What stopped robots, with the time of day at which it did."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

from app.drive.messages import IncidentEvent

_SHOWN = 20


@dataclass(frozen=True)
class Incident:
    """See ``app.drive.messages.IncidentEvent``.

    Attributes:
        at: wall clock, ISO 8601 in UTC.
    """

    role: str | None
    kind: str
    sentence: str
    speed_mps: float | None
    at: str

    def facts(self) -> dict[str, Any]:
        """As plain values, for JSON."""
        return asdict(self)


class Incidents:
    """The newest ones, oldest first."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self.newest: deque[Incident] = deque(maxlen=_SHOWN)

    def take(self, event: IncidentEvent) -> Incident:
        """Keep one."""
        ago = timedelta(seconds=max(0.0, self._clock() - event.time))
        at = (datetime.now(UTC) - ago).isoformat(timespec="milliseconds")
        incident = Incident(event.role, event.kind, event.sentence, event.speed_mps, at)
        self.newest.append(incident)
        return incident
