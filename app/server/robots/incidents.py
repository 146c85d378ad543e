"""Incidents that stopped robots, with their time of day."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

from app.contract.drive import IncidentEvent, StoppedEvent
from app.contract.robots import RobotIncident
from app.contract.values import filled
from app.server.robots.stop_figures import stop_figures
from app.server.robots.time_of_day import time_of_day
from observer.rig.rig import Role

_SHOWN = 20


@dataclass(frozen=True)
class NumberedIncident(RobotIncident):
    """See ``app.contract.drive.IncidentEvent``.

    Attributes:
        number: counted from 1. time: host's monotonic clock.
    """

    number: int
    time: float

    def is_ended_by(self, event: StoppedEvent) -> bool:
        """Return whether a robot's stop belongs to this incident."""
        return (
            (self.time, self.kind) == (event.incident_time, event.kind)
            and self.role in (event.role, None)
            and event.role not in self.stops
        )


class IncidentKeeper(Protocol):
    """Storage of incidents with a run."""

    def happened(self, incident: NumberedIncident) -> None: ...

    def stopped(self, incident: NumberedIncident, role: Role) -> None:
        """Handle a robot's measured stop, which has been added to the incident's ``stops``."""
        ...


class Incidents:
    """List of the newest incidents.

    Measurements of an incident go to the run in which it happened, even if that run has since
    ended.
    """

    def __init__(
        self, clock: Callable[[], float], run: Callable[[], IncidentKeeper | None]
    ) -> None:
        """Start without incidents.

        Args:
            clock: the host's monotonic clock. run: returns the run being recorded.
        """
        self._clock = clock
        self._run = run
        self._numbered = 0
        self._newest: deque[tuple[NumberedIncident, IncidentKeeper | None]] = deque(maxlen=_SHOWN)

    @property
    def newest(self) -> list[NumberedIncident]:
        """Return the newest incidents, oldest first."""
        return [incident for incident, _ in self._newest]

    def take(self, event: IncidentEvent) -> None:
        """Store an incident."""
        self._numbered += 1
        at = time_of_day(self._clock() - event.time)
        incident = filled(NumberedIncident, event, at=at, stops={}, number=self._numbered)
        run = self._run()
        if run is not None:
            run.happened(incident)
        self._newest.append((incident, run))

    def stopped(self, event: StoppedEvent) -> None:
        """Add a measured stop to its incident."""
        for place, (incident, run) in enumerate(self._newest):
            if incident.is_ended_by(event):
                stops = {**incident.stops, event.role: stop_figures(event)}
                ended = replace(incident, stops=stops)
                self._newest[place] = ended, run
                if run is not None:
                    run.stopped(ended, event.role)
                return
