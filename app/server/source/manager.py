"""The open source, its observation by the engine, and the newest observation."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from functools import partial

from app.contract.commands import CloseSource, OpenSource, RecordOrder
from app.contract.events import (
    EngineLostEvent,
    EngineState,
    LocalMapEvent,
    ObservationEvent,
    StateEvent,
)
from app.server.asking import ask
from app.server.errors import Conflict, FieldError, NotAvailable
from app.server.parameters.in_force import ParametersInForce
from app.server.parameters.manager import ParameterManager
from app.server.rig.store import RigStore
from app.server.shared import Shared
from app.server.source.camera_match import calibration_of_cameras
from app.server.source.chosen_source import ChosenSource, choose_source
from app.server.source.hints import is_for_calibrating
from app.server.source.live_truth import LiveTruthManager
from app.server.source.recent import RecentSources
from app.server.source.thumbnails import FOLDER as THUMBNAILS
from app.server.source.thumbnails import Thumbnails
from app.server.source_time import SourceTime
from observer.opening import shown_spec


class SourceManager:
    """Manager of the source; used in the event loop. Changes need the shared lock, except ``open``.

    Attributes:
        wanted: the source that is open or should be.
        state: the engine's last reported state. latest: the newest observation.
        local_map: newest local map of the observer; None before the first.
        time: the open source's clock.
        before: the source that was open before a run's recording was opened; None if there is none.
        recent: recently opened sources. thumbnails: pictures of sources to choose from.
        generation: number of the present engine process.
        restoring: whether a new engine still has to open the lost one's source.
        fruitless_losses: engines lost since the last observation or the last change of source.
    """

    def __init__(
        self,
        shared: Shared,
        source: str,
        parameters: ParameterManager,
        rig: RigStore,
        live_truth: LiveTruthManager,
    ) -> None:
        """Set up without opening anything.

        Args:
            source: source to open first.
        """
        self.wanted = ChosenSource(source, None)
        self.before: ChosenSource | None = None
        self.state = StateEvent(EngineState.IDLE, None)
        self.latest: ObservationEvent | None = None
        self.local_map: LocalMapEvent | None = None
        self.time = SourceTime()
        self.recent = RecentSources(shared)
        self.thumbnails = Thumbnails(shared.storage.folder.path / THUMBNAILS)
        self.generation = 0
        self.restoring = False
        self.fruitless_losses = 0
        self._shared = shared
        self._engine = shared.engine
        self._storage = shared.storage
        self._parameters = parameters
        self._rig = rig
        self._live_truth = live_truth

    def load(self) -> None:
        """Find the calibration of the first source; call it in a worker thread."""
        self.recent.load()
        calibration = calibration_of_cameras(self._storage, self.wanted.source)
        self.wanted = replace(
            self.wanted,
            calibration=calibration or self._storage.active_calibration(),
            name=self._storage.recording_name(self.wanted.source),
        )

    # --- requests --------------------------------------------------------------------------

    async def open(self, source: str, calibration_id: str | None) -> None:
        """Open another source.

        Raises:
            Conflict: a run is in progress. FieldError: the source or calibration cannot be used;
                the previous source stays open. NotAvailable: there is no engine at the moment.
        """
        async with self._shared.lock:
            self._shared.refuse_in_run("stop it before you open another source")
            self._shared.refuse_calibrating()
            chosen = await asyncio.to_thread(choose_source, self._storage, source, calibration_id)
            before = self.wanted
            await self.use(chosen)
            if chosen.name is None:
                self.before = None
            elif before.name is None:
                self.before = before

    async def go_back(self) -> None:
        """Reopen the source that was open before a run's recording.

        Raises:
            Conflict: there is nothing to go back to. Otherwise as for ``open``.
        """
        async with self._shared.lock:
            self._shared.refuse_in_run("stop it before you open another source")
            self._shared.refuse_calibrating()
            if self.before is None:
                raise Conflict(
                    "no recording of a run was opened, so there is no previous source to return to"
                )
            await self.use(self.before)
            self.before = None
            self._shared.followers.status_changed()

    async def use(self, chosen: ChosenSource) -> None:
        """Observe this source from now on, also after a restart of the engine.

        Raises:
            FieldError: the source cannot be used; the previous one stays open.
            NotAvailable: there is no engine at the moment.
        """
        await self.observe(chosen)
        self.wanted = chosen
        self.fruitless_losses = 0
        id = None if chosen.calibration is None else chosen.calibration.id
        self._shared.writer.post(partial(self._storage.activate_calibration, id))
        self._shared.followers.status_changed()

    async def observe(
        self,
        chosen: ChosenSource,
        *,
        run_id: str | None = None,
        segment: int = 0,
        record: RecordOrder | None = None,
        parameters: ParametersInForce | None = None,
    ) -> str:
        """Open a source in the engine and return the text of the calibration in use.

        Args:
            run_id, segment, record: of the run that records it.
            parameters: default: the current ones.

        Raises:
            FieldError, NotAvailable: as for ``use``.
        """
        parameters = parameters or self._parameters.current
        command = OpenSource(
            source=chosen.source,
            calibration_yaml=None if chosen.calibration is None else chosen.calibration.text,
            parameters=parameters.values.flat(),
            parameters_revision=parameters.revision,
            loop=run_id is None or chosen.endless,
            rate=self._rate(chosen),
            run_id=run_id,
            segment=segment,
            rig_yaml=self._rig.observed_text,
            record=record,
            truth=self._live_truth.order,
        )
        reply = await self._shared.open_in_engine(command)
        if run_id is None:
            self.recent.opened(chosen.source)
        self._shared.telemetry.new_source()
        self.latest = self.local_map = None
        self.time.begin()
        return str(reply.calibration_yaml)

    def _rate(self, chosen: ChosenSource) -> float:
        """Return the playback rate: the present one if the source stays the same, else 1."""
        before, playback = self.state.source, self.state.playback
        same = before is not None and before.spec == shown_spec(chosen.source)
        return playback.rate if same and playback is not None else 1.0

    @property
    def name(self) -> str | None:
        """Return the display name of the open source: the run of a recording, or its spec."""
        info = self.state.source
        if info is None:
            return None
        wanted = self.wanted
        return (wanted.name if shown_spec(wanted.source) == info.spec else None) or info.spec

    async def run_renamed(self) -> None:
        """Update the display name of the source after a run was renamed."""
        if self.wanted.name is not None:
            name = await asyncio.to_thread(self._storage.recording_name, self.wanted.source)
            self.wanted = replace(self.wanted, name=name)
            self._shared.followers.status_changed()

    @property
    def to_calibrate(self) -> str | None:
        """Return the wanted source if it must be calibrated first, which the page offers."""
        wanted = self.wanted
        waits = wanted.calibration is None and is_for_calibrating(wanted.source)
        return wanted.source if waits else None

    async def restore(self) -> None:
        """Observe the wanted source again, without its calibration if that does not fit.

        A source that must be calibrated first stays closed.

        Raises:
            FieldError: the source cannot be opened. NotAvailable: there is no engine.
        """
        if self.to_calibrate is not None:
            return
        try:
            await self.observe(self.wanted)
        except FieldError as error:
            if self.wanted.calibration is None:
                raise
            self._shared.warnings.append(
                f"the calibration {self.wanted.calibration.name} is no longer used: {error}"
            )
            await self.use(replace(self.wanted, calibration=None))

    async def reopen(self) -> None:
        """Reopen the source from before a calibration."""
        try:
            await self.restore()
        except (FieldError, Conflict, NotAvailable) as error:
            # Do not leave the calibration's source open.
            await ask(self._engine, CloseSource())
            self.failed(str(error))
        self._shared.followers.status_changed()

    # --- events of the engine --------------------------------------------------------------

    def observed(self, event: ObservationEvent) -> None:
        """Store the observation of a frame."""
        self.latest = event
        self.time.observed(event)
        self.fruitless_losses = 0

    def state_changed(self, event: StateEvent) -> bool:
        """Store the engine's state; return False if it must not be shown yet."""
        if self.restoring and event.state is EngineState.IDLE:
            # A new engine has no source open yet; until it has, show the lost engine's state.
            self.state = replace(self.state, preparing=event.preparing)
            return False
        self.state = event
        self.time.live = event.source is not None and event.source.live
        return True

    def engine_started(self, generation: int) -> bool:
        """Return whether this is a new engine process."""
        if generation <= self.generation:
            return False
        self.generation = generation
        return True

    def engine_lost(self, event: EngineLostEvent) -> None:
        """Note that there is no engine until the next one has started."""
        self.fruitless_losses += 1
        self.restoring = True
        self.local_map = None
        self.failed(f"{event.reason}; it is restarting")

    def failed(self, reason: str) -> None:
        """Set the state to failed, with the reason in one sentence."""
        self.state = replace(self.state, state=EngineState.FAILED, reason=reason)
