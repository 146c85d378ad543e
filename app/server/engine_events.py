"""Distribution of the engine's events; a new engine continues where a lost one stopped."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import structlog

from app.contract.events import (
    BoardLookEvent,
    BoardViewsEvent,
    DenseStereoEvent,
    EngineLostEvent,
    EngineStartedEvent,
    Event,
    LocalMapEvent,
    ObservationEvent,
    SkippedFrameEvent,
    StateEvent,
)
from app.server.calibrating.session import CalibrationSession
from app.server.errors import Conflict, FieldError, NotAvailable
from app.server.rig.drive_survey import DriveSurvey
from app.server.robots import RobotManager
from app.server.runs.manager import RunManager
from app.server.shared import Shared
from app.server.source.manager import SourceManager
from app.server.source.watched_views import Watching
from app.storage import RunState
from observer.opening import shown_spec

log = structlog.get_logger(__name__)

# Engines lost without a single observation in between: another attempt would not help.
_MOST_FRUITLESS_LOSSES = 3


@dataclass(eq=False)
class EngineEvents:
    """Follower of the engine; runs in the event loop."""

    _shared: Shared
    _source: SourceManager
    _runs: RunManager
    _session: CalibrationSession
    _robots: RobotManager
    _survey: DriveSurvey
    _watching: Watching
    _unsubscribe: Callable[[], None] = lambda: None

    def follow(self) -> None:
        """Start to receive the engine's events."""
        self._unsubscribe = self._shared.engine.subscribe(self._heard)

    def unfollow(self) -> None:
        """Stop receiving events; safe to call twice."""
        self._unsubscribe()

    def engine_started(self, generation: int) -> None:
        """Set a new engine up like the lost one; do nothing if it is not a new one."""
        if self._source.engine_started(generation):
            self._shared.telemetry.new_engine()
            self._watching.engine_started()
            self._shared.background.start(self._restore())

    def _heard(self, event: Event) -> None:
        match event:
            case ObservationEvent():
                self._observed(event)
            case StateEvent():
                self._state_changed(event)
            case BoardLookEvent():
                # During calibration nothing is observed; a search for the board proves as well that
                # the engine works.
                self._source.fruitless_losses = 0
                self._session.looked(event)
            case BoardViewsEvent():
                self._session.views_changed(event)
            case SkippedFrameEvent():
                self._shared.telemetry.frame_skipped(event)
            case DenseStereoEvent():
                if self._shared.telemetry.dense_made(event, self._shared.clock()):
                    self._shared.followers.status_changed()
            case LocalMapEvent():
                self._source.local_map = event
            case EngineStartedEvent():
                self.engine_started(event.generation)
            case EngineLostEvent():
                self._source.engine_lost(event)
                self._shared.followers.status_changed()
            case _:
                pass

    def _observed(self, event: ObservationEvent) -> None:
        self._source.observed(event)
        self._shared.telemetry.observed(event, self._shared.clock())
        self._runs.observed(event)
        self._survey.observed(event)
        self._shared.followers.observed(event)

    def _state_changed(self, event: StateEvent) -> None:
        if self._source.state_changed(event):
            self._robots.source_changed(event)
            self._runs.state_changed(event)
            self._shared.followers.status_changed()

    async def _restore(self) -> None:
        """Set a new engine up like the lost one; a run continues as a new segment."""
        async with self._shared.lock:
            source = self._source
            generation = source.generation
            if self._shared.opened_by == generation:
                # A request that waited for this engine has set it up already.
                source.restoring = False
                return
            try:
                self._refuse_fruitless()
                if self._session.source is not None:
                    await self._session.resume()
                elif self._runs.running is None:
                    await source.restore()
                else:
                    await self._runs.resume()
            except NotAvailable as error:
                # This engine is gone as well; the next one will be set up the same way.
                log.warning("not_restored", reason=str(error))
            except (FieldError, Conflict) as error:
                source.restoring = False
                if self._runs.running is not None:
                    await self._runs.close(RunState.FAILED, str(error))
                source.failed(str(error))
            else:
                # If this engine has been lost again, the next one still has to be set up.
                health = self._shared.engine.health
                source.restoring = not (health.alive and health.generation == generation)
            finally:
                self._shared.followers.status_changed()

    def _refuse_fruitless(self) -> None:
        losses = self._source.fruitless_losses
        if losses >= _MOST_FRUITLESS_LOSSES:
            raise Conflict(
                f"the engine crashed {losses} times in a row on "
                f"{shown_spec(self._session.source or self._source.wanted.source)}; choose another "
                "source"
            )
