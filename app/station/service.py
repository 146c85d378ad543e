"""The station: what the server does, apart from how it is asked.

It owns the engine, the database, the parameters, the open source and the run that is kept.
Everything runs in one event loop; database calls run in threads.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable, Coroutine
from dataclasses import replace
from functools import partial
from typing import Any

import structlog

from app.messages import (
    EngineLostEvent,
    EngineStartedEvent,
    EngineState,
    Event,
    ObservationEvent,
    SetPlayback,
    SkippedFrameEvent,
    StateEvent,
    StopRun,
)
from app.parameter_store import ParametersInForce
from app.station.archive import RunArchive, no_such_run
from app.station.asking import ask
from app.station.calibrations import find_calibration
from app.station.contracts import Engine
from app.station.current_run import CurrentRun, versions
from app.station.errors import Conflict, FieldError, NotAvailable
from app.station.followers import Followers
from app.station.opening import Opening, make_opening
from app.station.parameter_desk import ParameterDesk
from app.station.telemetry import Telemetry
from app.station.watching import Watching
from app.station.writer import Writer
from app.storage import RunRecord, RunState, Storage, StorageError

log = structlog.get_logger(__name__)

# Building an index of a large data set takes a while.
_OPEN_TIMEOUT_S = 60.0
_FRUITLESS_RESTARTS = 3


class Station:
    """See the module.

    Attributes:
        parameters: parameters and presets. runs: those that were kept.
        followers: who is told of everything. watching: which views are looked at.
        telemetry: figures of the running loop. writer: the way into the database.
        state: the engine's last word on itself. latest: the newest observation.
        viewers: open live pages. warnings: sentences for the person at the page.
    """

    def __init__(
        self,
        engine: Engine,
        storage: Storage,
        *,
        source: str,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.engine = engine
        self.storage = storage
        self.clock = clock
        self.writer = Writer()
        self.telemetry = Telemetry()
        self.followers = Followers()
        self.watching = Watching(engine)
        self.parameters = ParameterDesk(engine, storage, self.writer)
        self.runs = RunArchive(storage, lambda: self.run)
        self.state = StateEvent(EngineState.IDLE, None)
        self.latest: ObservationEvent | None = None
        self.viewers = 0
        self.warnings: list[str] = []
        self._wanted = Opening(source, None)
        self._run: CurrentRun | None = None
        self._generation = 0
        # One change of source, run, calibration or parameters at a time.
        self._lock = asyncio.Lock()
        self._tasks: set[asyncio.Task[None]] = set()
        self._unsubscribe: Callable[[], None] = lambda: None
        self._started = False

    # --- life ------------------------------------------------------------------------------

    async def start(self) -> None:
        """Open the database, start the engine and open the first source in the background.

        Raises:
            StorageError: the database cannot be used; nothing was started.
        """
        await asyncio.to_thread(self._load)
        self.writer.start()
        self._started = True
        self._unsubscribe = self.engine.subscribe(self._on_event)
        self._spawn(self.watching.run())
        await self.engine.start()
        # An engine that was up before somebody listened.
        if self.engine.health.alive and self.engine.health.generation > self._generation:
            self._engine_started(self.engine.health.generation)

    async def stop(self) -> None:
        """End the run, the engine and the database; safe to call twice and half-way."""
        self._unsubscribe()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        if self._run is not None:
            await self._close_run(RunState.INTERRUPTED, "the server was stopped during the run")
        await self.engine.stop()
        if self._started:
            await asyncio.to_thread(self.writer.stop)
        await asyncio.to_thread(self.storage.close)

    def _load(self) -> None:
        self.storage.open()
        self.warnings.extend(self.storage.warnings)
        self.storage.mark_interrupted_runs()
        warning = self.parameters.load()
        if warning is not None:
            self.warnings.append(warning)
        self._wanted = replace(self._wanted, calibration=self.storage.active_calibration())

    def _spawn(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._task_done)

    def _task_done(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and task.exception() is not None:
            log.error("background_work_failed", exc_info=task.exception())

    # --- events ----------------------------------------------------------------------------

    def _on_event(self, event: Event) -> None:
        match event:
            case ObservationEvent():
                self._observed(event)
            case StateEvent():
                self._state_changed(event)
            case SkippedFrameEvent():
                self.telemetry.frame_skipped(event)
            case EngineStartedEvent():
                self._engine_started(event.generation)
            case EngineLostEvent():
                self._engine_lost(event)
            case _:
                pass

    def _observed(self, event: ObservationEvent) -> None:
        self.latest = event
        self.telemetry.observed(event, self.clock())
        if self._run is not None and event.run_id == self._run.id:
            self._run.observed(event)
        self.followers.observed(event)

    def _state_changed(self, event: StateEvent) -> None:
        self.state = event
        playback = event.playback or {}
        run = self._run
        if run is not None and event.run_id == run.id and playback.get("ended"):
            self._spawn(self._finish_played_run(run))
        self.followers.status_changed()

    def _engine_started(self, generation: int) -> None:
        if generation <= self._generation:
            return
        self._generation = generation
        self.telemetry.new_engine()
        self.watching.engine_started()
        self._spawn(self._restore())

    def _engine_lost(self, event: EngineLostEvent) -> None:
        reason = f"{event.reason}; it is being restarted"
        self.state = replace(self.state, state=EngineState.FAILED, reason=reason)
        self.followers.status_changed()

    @property
    def generation(self) -> int:
        """Number of the engine process that is being heard."""
        return self._generation

    # --- source ----------------------------------------------------------------------------

    @property
    def wanted(self) -> Opening:
        """What is open, or was meant to be."""
        return self._wanted

    async def open_source(self, source: str, calibration_id: str | None) -> None:
        """Show another source.

        Raises:
            Conflict: a run is going. FieldError: the source or calibration cannot be used;
                what was open stays open. NotAvailable: there is no engine at the moment.
        """
        async with self._lock:
            self._refuse_in_run("stop it before you open another source")
            opening = await asyncio.to_thread(make_opening, self.storage, source, calibration_id)
            await self._use(opening)

    async def play(self, change: SetPlayback) -> dict[str, Any]:
        """Change the playback and return it as it is then."""
        return await ask(self.engine, change)

    async def _use(self, opening: Opening) -> None:
        await self._open(opening)
        self._wanted = opening
        id = None if opening.calibration is None else opening.calibration.id
        self.writer.post(partial(self.storage.activate_calibration, id))
        self.followers.status_changed()

    async def _open(
        self,
        opening: Opening,
        run: CurrentRun | None = None,
        *,
        segment: int = 0,
        parameters: ParametersInForce | None = None,
    ) -> None:
        command = opening.command(
            parameters or self.parameters.current,
            playback=self.state.playback,
            run_id=None if run is None else run.id,
            segment=segment,
        )
        await ask(self.engine, command, field=("body", "source"), timeout_s=_OPEN_TIMEOUT_S)
        self.telemetry.new_source()

    async def _restore(self) -> None:
        """Have a new engine do what the lost one did; a run goes on as a new segment."""
        async with self._lock:
            run = self._run
            try:
                if run is None:
                    await self._restore_preview()
                    return
                run.fruitless_restarts += 1
                if run.fruitless_restarts > _FRUITLESS_RESTARTS:
                    raise NotAvailable(
                        f"the engine ended {_FRUITLESS_RESTARTS} times without a result"
                    )
                segment = run.segments
                await self._open(self._wanted, run, segment=segment)
                run.segments = max(run.segments, segment + 1)
            except NotAvailable as error:
                if run is not None and run.fruitless_restarts > _FRUITLESS_RESTARTS:
                    await self._close_run(RunState.FAILED, str(error))
                log.warning("not_restored", reason=str(error))
            except (FieldError, Conflict) as error:
                self.state = replace(self.state, state=EngineState.FAILED, reason=str(error))
                if run is not None:
                    await self._close_run(RunState.FAILED, str(error))
            finally:
                self.followers.status_changed()

    async def _restore_preview(self) -> None:
        try:
            await self._open(self._wanted)
        except FieldError as error:
            if self._wanted.calibration is None:
                raise
            self.warnings.append(
                f"the calibration {self._wanted.calibration.name} is not used any more: {error}"
            )
            await self._use(replace(self._wanted, calibration=None))

    def _refuse_in_run(self, remedy: str) -> None:
        if self._run is not None:
            raise Conflict(f"the run {self._run.record.name} is going; {remedy}")

    # --- runs ------------------------------------------------------------------------------

    @property
    def run(self) -> RunRecord | None:
        """The run that is kept at this moment."""
        return None if self._run is None else self._run.snapshot()

    async def start_run(
        self,
        *,
        name: str | None,
        source: str | None,
        calibration_id: str | None,
        preset: str | None,
        parameters: dict[str, Any],
    ) -> RunRecord:
        """Keep what is observed from now on, from the source's beginning.

        Args:
            source: what is open if left out. calibration_id: the source's own if left out
                together with a source, otherwise the one in use.

        Raises:
            Conflict: a run is going. FieldError, ParameterError: nothing was changed.
            NotAvailable, StorageError: nothing was changed.
        """
        async with self._lock:
            self._refuse_in_run("stop it first")
            revision = self.parameters.plan(preset, parameters)
            opening = self._wanted
            if source is not None or calibration_id is not None:
                opening = await asyncio.to_thread(
                    make_opening, self.storage, source or self._wanted.source, calibration_id
                )
            record = await asyncio.to_thread(
                partial(
                    self.storage.create_run,
                    name=name or f"Run of {opening.source}"[:100],
                    source=opening.source,
                    parameters=dict(revision.after.values.flat()),
                    versions=versions(),
                    calibration_id=None if opening.calibration is None else opening.calibration.id,
                    preset=revision.after.preset,
                )
            )
            run = self._run = CurrentRun(record, self.storage, self.writer, self.clock)
            try:
                await self._open(opening, run, parameters=revision.after)
            except BaseException:
                self._run = None
                await self._forget(record.id)
                raise
            self._wanted = opening
            self.parameters.adopt(revision, 0, run.id)
            self.followers.status_changed()
            return run.snapshot()

    async def _forget(self, run_id: str) -> None:
        """A run that never began is not kept."""
        with contextlib.suppress(NotAvailable, StorageError):
            await self.writer.submit(partial(self.storage.delete_run, run_id), timeout_s=2.0)

    async def stop_run(self, run_id: str) -> RunRecord:
        """End the run; its source stays open.

        Raises:
            NotThere: there is no such run. Conflict: it has ended already.
        """
        async with self._lock:
            if self._run is None or self._run.id != run_id:
                record = await self.runs.find(run_id)
                raise Conflict(f"the run {record.name} has ended already ({record.state.value})")
            return await self._close_run(RunState.FINISHED, None)

    async def _finish_played_run(self, run: CurrentRun) -> None:
        async with self._lock:
            if self._run is run:
                await self._close_run(RunState.FINISHED, None)

    async def _close_run(self, state: RunState, reason: str | None) -> RunRecord:
        run = self._run
        assert run is not None
        with contextlib.suppress(NotAvailable, Conflict, FieldError):
            await ask(self.engine, StopRun())
            if not self._wanted.endless:
                # Its run ended with the recording; the preview goes round.
                await ask(self.engine, SetPlayback(loop=True))
        self._run = None
        run.flush()
        ended = run.ended(state, reason)
        write = partial(
            self.storage.update_run,
            run.id,
            state=state,
            frames=ended.frames,
            segments=ended.segments,
            reason=reason,
        )
        try:
            ended = await self.writer.submit(write, timeout_s=2.0)
        except (NotAvailable, StorageError) as error:
            # The run is over whether or not it could be written: stopping always works.
            log.error("end_of_run_not_written", run=run.id, reason=str(error))
        self.followers.status_changed()
        return ended

    async def delete_run(self, run_id: str) -> None:
        """Forget a run that has ended."""
        async with self._lock:
            if self._run is not None and self._run.id == run_id:
                self._refuse_in_run("stop it before you delete it")
            if not await asyncio.to_thread(self.storage.delete_run, run_id):
                raise no_such_run(run_id)

    # --- parameters ------------------------------------------------------------------------

    async def change_parameters(self, changes: dict[str, Any]) -> ParametersInForce:
        """Change parameters from the next frame on, all or nothing.

        Raises:
            ParameterError: naming every refused field and its range.
        """
        async with self._lock:
            revision = self.parameters.plan(None, changes)
            run_id = None if self._run is None else self._run.id
            result = await self.parameters.apply(revision, run_id)
        self.followers.status_changed()
        return result

    # --- calibrations ----------------------------------------------------------------------

    async def activate_calibration(self, id: str | None) -> None:
        """Use this calibration with the open source; None goes back to the source's own.

        Raises:
            Conflict: a run is going. FieldError: it does not fit the source's images.
        """
        async with self._lock:
            self._refuse_in_run("stop it before you change the calibration")
            record = None
            if id is not None:
                record = await asyncio.to_thread(find_calibration, self.storage, id)
            if record == self._wanted.calibration and self.state.state is EngineState.PREVIEW:
                return
            await self._use(replace(self._wanted, calibration=record))

    async def delete_calibration(self, id: str) -> None:
        """Take a calibration off the list."""
        async with self._lock:
            active = self._wanted.calibration
            if active is not None and active.id == id:
                raise Conflict(f"the calibration {active.name} is in use; deactivate it first")
            await asyncio.to_thread(find_calibration, self.storage, id)
            await asyncio.to_thread(self.storage.delete_calibration, id)
