"""Which source is open, how the engine observes it, and the newest of what it saw."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from functools import partial

from app.contract.commands import CloseSource, RecordOrder, SetPlayback
from app.contract.events import EngineLostEvent, EngineState, ObservationEvent, StateEvent
from app.contract.status import PlaybackStatus
from app.server.asking import ask
from app.server.errors import Conflict, FieldError, NotAvailable
from app.server.parameters.in_force import ParametersInForce
from app.server.parameters.manager import ParameterManager
from app.server.rig.store import RigStore
from app.server.shared import Shared
from app.server.source.camera_match import calibration_of_cameras
from app.server.source.live_truth import LiveTruthManager
from app.server.source.opening import Opening, make_opening
from observer.opening import shown_spec

# Building an index of a large data set takes a while.
_OPEN_TIMEOUT_S = 60.0


class SourceManager:
    """Used in the event loop; but for ``open``, changes need the shared lock.

    Attributes:
        wanted: what is open, or was meant to be.
        state: the engine's last word on itself. latest: the newest observation.
        generation: number of the engine process that is being heard.
        restoring: whether a new engine has yet to open what a lost one had.
        fruitless_losses: engines lost since something was observed, or something else opened.
    """

    def __init__(
        self,
        shared: Shared,
        source: str,
        parameters: ParameterManager,
        rig: RigStore,
        live_truth: LiveTruthManager,
    ) -> None:
        """
        Args:
            source: opened first.
        """
        self.wanted = Opening(source, None)
        self.state = StateEvent(EngineState.IDLE, None)
        self.latest: ObservationEvent | None = None
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
        """Find the calibration of the first source; the server's start is another thread."""
        calibration = calibration_of_cameras(self._storage, self.wanted.source)
        self.wanted = replace(
            self.wanted, calibration=calibration or self._storage.active_calibration()
        )

    # --- what is asked for -----------------------------------------------------------------

    async def open(self, source: str, calibration_id: str | None) -> None:
        """Show another source.

        Raises:
            Conflict: a run is going. FieldError: the source or calibration cannot be used;
                what was open stays open. NotAvailable: there is no engine at the moment.
        """
        async with self._shared.lock:
            self._shared.refuse_in_run("stop it before you open another source")
            self._shared.refuse_calibrating()
            await self.use(
                await asyncio.to_thread(make_opening, self._storage, source, calibration_id)
            )

    async def play(self, change: SetPlayback) -> PlaybackStatus:
        """Change the playback and return it as it is then."""
        return await ask(self._engine, change)

    async def use(self, opening: Opening) -> None:
        """Observe this from now on, also after a restart of the engine.

        Raises:
            FieldError: it cannot be used; what was open stays open.
            NotAvailable: there is no engine at the moment.
        """
        await self.observe(opening)
        self.wanted = opening
        self.fruitless_losses = 0
        id = None if opening.calibration is None else opening.calibration.id
        self._shared.writer.post(partial(self._storage.activate_calibration, id))
        self._shared.followers.status_changed()

    async def observe(
        self,
        opening: Opening,
        *,
        run_id: str | None = None,
        segment: int = 0,
        record: RecordOrder | None = None,
        parameters: ParametersInForce | None = None,
    ) -> str:
        """Have the engine open it; returns the text of the calibration that is used.

        Args:
            run_id, segment, record: of the run that is kept of it.
            parameters: those in force if left out.

        Raises:
            FieldError, NotAvailable: as ``use``.
        """
        before = self.state.source
        same = before is not None and before.spec == shown_spec(opening.source)
        command = opening.command(
            parameters or self._parameters.current,
            playback=self.state.playback if same else None,
            run_id=run_id,
            segment=segment,
            rig_yaml=self._rig.observed_text,
            record=record,
            truth=self._live_truth.order,
        )
        reply = await ask(
            self._engine, command, field=("body", "source"), timeout_s=_OPEN_TIMEOUT_S
        )
        self._shared.telemetry.new_source()
        self.latest = None
        return str(reply.calibration_yaml)

    async def restore(self) -> None:
        """Observe anew what was wanted, without its calibration if that is what does not fit.

        Raises:
            FieldError: the source cannot be opened. NotAvailable: there is no engine.
        """
        try:
            await self.observe(self.wanted)
        except FieldError as error:
            if self.wanted.calibration is None:
                raise
            self._shared.warnings.append(
                f"the calibration {self.wanted.calibration.name} is not used any more: {error}"
            )
            await self.use(replace(self.wanted, calibration=None))

    async def reopen(self) -> None:
        """Observe again what was open before something was calibrated."""
        try:
            await self.restore()
        except (FieldError, Conflict, NotAvailable) as error:
            # Nothing of what was calibrated stays open behind it.
            await ask(self._engine, CloseSource())
            self.failed(str(error))
        self._shared.followers.status_changed()

    # --- what the engine tells -------------------------------------------------------------

    def observed(self, event: ObservationEvent) -> None:
        """A frame was observed."""
        self.latest = event
        self.fruitless_losses = 0

    def state_changed(self, event: StateEvent) -> bool:
        """Keep the engine's word on itself; False where it is not to be seen yet."""
        if self.restoring and event.state is EngineState.IDLE:
            # A new engine has nothing open yet; until it has, what was lost is to be seen.
            return False
        self.state = event
        return True

    def engine_started(self, generation: int) -> bool:
        """Whether this is another engine process than before."""
        if generation <= self.generation:
            return False
        self.generation = generation
        return True

    def engine_lost(self, event: EngineLostEvent) -> None:
        """There is no engine until the next one has started."""
        self.fruitless_losses += 1
        self.restoring = True
        self.failed(f"{event.reason}; it is being restarted")

    def failed(self, reason: str) -> None:
        """Nothing is observed, in one sentence."""
        self.state = replace(self.state, state=EngineState.FAILED, reason=reason)
