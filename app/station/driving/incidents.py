"""What stopped robots, with the time of day at which it did."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime, timedelta
from typing import Any

from app.drive.messages import IncidentEvent, StoppedEvent
from app.station.driving.stop_figures import StopFigures

_SHOWN = 20


@dataclass(frozen=True)
class Incident:
    """See ``app.drive.messages.IncidentEvent``.

    Attributes:
        at: wall clock, ISO 8601 in UTC.
        stops: by role, how each robot that moved came to stand; empty until it does.
        time: host's monotonic clock.
    """

    role: str | None
    kind: str
    sentence: str
    speed_mps: float | None
    at: str
    stops: Mapping[str, StopFigures] = field(default_factory=dict)
    time: float | None = None

    def facts(self) -> dict[str, Any]:
        """As plain values, for JSON."""
        values = asdict(self)
        del values["time"]
        return values


class Incidents:
    """The newest ones, oldest first."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self.newest: deque[Incident] = deque(maxlen=_SHOWN)

    def take(self, event: IncidentEvent) -> Incident:
        """Keep one."""
        ago = timedelta(seconds=max(0.0, self._clock() - event.time))
        at = (datetime.now(UTC) - ago).isoformat(timespec="milliseconds")
        incident = Incident(
            event.role, event.kind, event.sentence, event.speed_mps, at, time=event.time
        )
        self.newest.append(incident)
        return incident

    def stopped(self, event: StoppedEvent) -> None:
        """Tell with the incident how it ended."""
        for place, incident in enumerate(self.newest):
            if (incident.time, incident.kind) == (event.incident_time, event.kind) and (
                incident.role in (event.role, None)
            ):
                stops = {**incident.stops, event.role: StopFigures.of(event)}
                self.newest[place] = replace(incident, stops=stops)
                return
