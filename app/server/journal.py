"""Log of what happened on the server that users should know: the last entries, kept in memory.

It follows the server and notes what has changed since its last look, so no part of the server has
to report to it. What is not a state, such as a refusal, is noted by the code that knows of it.
"""

from __future__ import annotations

import re
import time
from collections import deque
from collections.abc import Callable

from app.contract.events import EngineState, ObservationEvent
from app.contract.journal import LOG_LENGTH, LogEntry, Severity
from app.contract.robots import RobotIncident
from app.server.server import Server
from app.server.status import warnings
from observer.opening import shown_spec

_LONGEST = 500
# Numbers in a warning: if only they change, it is still the same warning.
_FIGURES = re.compile(r"[-+]?\d+(?:\.\d+)?")


class Journal:
    """The log of a server.

    Args:
        wall_clock: seconds since 1970. most: number of entries kept.

    Attributes:
        newest: number of the newest entry; 0 before the first.
        changed: called after every entry.
    """

    def __init__(
        self, server: Server, wall_clock: Callable[[], float] = time.time, most: int = LOG_LENGTH
    ) -> None:
        self._server = server
        self._wall_clock = wall_clock
        self._entries: deque[LogEntry] = deque(maxlen=most)
        self.newest = 0
        self.changed: Callable[[], None] = lambda: None
        self._source: str | None = None
        self._run: str | None = None
        self._calibration: str | None = None
        self._failure: str | None = None
        self._restarts = 0
        self._warned: set[str] = set()
        self._stopped_by: str | None = None
        self._incidents: tuple[RobotIncident, ...] = ()

    def follow(self) -> Callable[[], None]:
        """Note what happens from now on; return a function that ends this."""
        self.note("info", "Server started.")
        self.status_changed()
        return self._server.followers.follow(self)

    def since(self, number: int) -> list[LogEntry]:
        """Return the entries after this one, oldest first."""
        return [entry for entry in self._entries if entry.number > number]

    def note(self, severity: Severity, text: str) -> None:
        """Add an entry.

        Args:
            text: a sentence in the style of an error message; capital and full stop are added.
        """
        self.newest += 1
        if len(text) > _LONGEST:
            text = f"{text[:_LONGEST].rsplit(maxsplit=1)[0].rstrip(' .,:;')}…"
        sentence = text[:1].upper() + text[1:]
        if not sentence.endswith((".", "!", "?", "…")):
            sentence += "."
        self._entries.append(LogEntry(self.newest, self._wall_clock(), severity, sentence))
        self.changed()

    # --- follower of the server -------------------------------------------------------------

    def observed(self, event: ObservationEvent) -> None:
        """Do nothing: single frames are not logged."""

    def status_changed(self) -> None:
        """Note what has changed in the server's status."""
        self._look_at_engine()
        self._look_at_source()
        self._look_at_run()
        found = {_FIGURES.sub("#", each): each for each in warnings(self._server)}
        for key in found.keys() - self._warned:
            self.note("warning", found[key])
        self._warned = set(found)

    def robots_changed(self) -> None:
        """Note what has happened to the robots."""
        facts = self._server.driving.facts()
        by = None if facts.stopped is None else facts.stopped.by
        if by != self._stopped_by:
            if by is not None:
                self.note("warning", f"all robots were stopped by {by}")
            else:
                self.note("info", "the robot stop was reset")
            self._stopped_by = by
        incidents = tuple(facts.incidents)
        known = {(each.at, each.role, each.kind) for each in self._incidents}
        for each in incidents:
            # The stop of all robots is noted above.
            if each.kind != "stop" and (each.at, each.role, each.kind) not in known:
                whose = "" if each.role is None else f"{each.role}: "
                self.note("warning", f"{whose}{each.sentence}")
        self._incidents = incidents

    # --- parts of the status ------------------------------------------------------------------

    def _look_at_engine(self) -> None:
        restarts = self._server.engine.health.restarts
        if restarts > self._restarts:
            self.note("warning", "the engine stopped and was restarted")
        self._restarts = restarts
        state = self._server.source.state
        failure = state.reason if state.state is EngineState.FAILED else None
        if failure is not None and failure != self._failure:
            self.note("error", failure)
        self._failure = failure

    def _look_at_source(self) -> None:
        source = self._server.source.state.source
        spec = None if source is None else shown_spec(source.spec)
        if spec is not None and spec != self._source:
            self.note("info", f"source {spec} was opened")
        self._source = spec or self._source
        calibration = self._server.source.wanted.calibration
        name = None if calibration is None else calibration.name
        if name is not None and name != self._calibration:
            self.note("info", f'calibration "{name}" is in use')
        self._calibration = name

    def _look_at_run(self) -> None:
        run = self._server.runs.current
        name = None if run is None else run.name
        if name != self._run:
            if self._run is not None:
                self.note("info", f'run "{self._run}" ended')
            if name is not None:
                self.note("info", f'run "{name}" started')
        self._run = name
