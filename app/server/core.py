"""What keeps engine, source and run in step, whatever happens to the engine.

Everything runs in one event loop; database calls run in threads.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import structlog

from app.messages import (
    BoardLookEvent,
    BoardViewsEvent,
    CloseSource,
    DenseStereoEvent,
    EngineLostEvent,
    EngineStartedEvent,
    EngineState,
    Event,
    ObservationEvent,
    SkippedFrameEvent,
    StateEvent,
)
from app.parameter_store import ParametersInForce
from app.server.asking import ask
from app.server.background import Background
from app.server.calibrating.session import CalibrationDesk
from app.server.contracts import Drive, Engine
from app.server.errors import Conflict, FieldError, NotAvailable
from app.server.followers import Followers
from app.server.parameters.desk import ParameterDesk
from app.server.rig.drive_survey import DriveSurvey
from app.server.rig.rig_desk import RigDesk
from app.server.robots import AbsentDrive, DrivingDesk
from app.server.robots.circumstances import Circumstances
from app.server.robots.profile_library import ProfileLibrary
from app.server.runs.archive import RunArchive
from app.server.runs.current_run import CurrentRun
from app.server.runs.ending import end_recording, write_end
from app.server.runs.files import RunFiles
from app.server.runs.history import HistoryDesk
from app.server.runs.recording import (
    complete_recording,
    keep_telling,
    record_order,
    tell_robots,
)
from app.server.runs.saved_clips import RingDesk
from app.server.runs.truths import TruthFiles
from app.server.runs.writer import Writer
from app.server.source.camera_match import calibration_of_cameras
from app.server.source.live_truth import TruthDesk
from app.server.source.opening import Opening
from app.server.source.watched_views import Watching
from app.server.telemetry import Telemetry
from app.storage import RunRecord, RunState, Storage
from app.versions import versions
from observer.opening import shown_spec
from observer.rig.rig import ROLES

log = structlog.get_logger(__name__)

# Building an index of a large data set takes a while.
_OPEN_TIMEOUT_S = 60.0
# Engines lost without a single observation between: more of the same would not help.
_MOST_FRUITLESS_LOSSES = 3


class StationCore:
    """The part of the station that acts by itself; see ``app.server.service`` for the rest.

    Attributes:
        parameters: parameters and presets. runs, history, run_files: those kept. truths: of them.
        followers: who is told of everything. watching: which views are looked at.
        telemetry: figures of the running loop. writer: the way into the database.
        calibrating: what is being calibrated. rig: how the cameras stand on their robot.
        drive: notes a drive, by which that is estimated. driving: the robots.
        programmes: what they can be told to drive. rings: saves the last half minute.
        state: the engine's last word on itself. latest: the newest observation.
        viewers: open live pages. warnings: sentences for the person at the page.
    """

    def __init__(
        self,
        engine: Engine,
        storage: Storage,
        *,
        source: str,
        rig_file: Path | None = None,
        programme_folder: Path | None = None,
        check_folder: Path | None = None,
        drive: Drive | None = None,
        ring_at_guard_stops: bool = True,
        live_truth: str | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.engine = engine
        self.storage = storage
        self.clock = clock
        self.writer = Writer()
        self.telemetry = Telemetry()
        self.followers = Followers()
        self.watching = Watching(engine)
        self.calibrating = CalibrationDesk(engine, self.followers.status_changed)
        self.parameters = ParameterDesk(engine, storage, self.writer)
        self.rig = RigDesk(rig_file)
        self.live_truth = TruthDesk(engine, storage, self.followers.status_changed, live_truth)
        self.drive = DriveSurvey()
        drive = drive or AbsentDrive()
        self.driving = DrivingDesk(
            drive,
            rig=lambda: self.rig.rig,
            guard=lambda: self.parameters.group("guard"),
            changed=self.followers.robots_changed,
            run=lambda: self._run,
            circumstances=self._circumstances,
            check_folder=check_folder,
            clock=clock,
        )
        self.programmes = ProfileLibrary(programme_folder)
        self.parameters.followed = self.driving.guard_changed
        self.runs = RunArchive(storage, lambda: self.run)
        self.history = HistoryDesk(storage, lambda: self._run, clock)
        self.run_files = RunFiles(storage, self.runs)
        self.truths = TruthFiles(storage, self.runs, self.run_files.quick)
        self.state = StateEvent(EngineState.IDLE, None)
        self.latest: ObservationEvent | None = None
        self.viewers = 0
        self.warnings: list[str] = []
        self._wanted = Opening(source, None)
        self._run: CurrentRun | None = None
        self._generation = 0
        self._fruitless_losses = 0
        self._restoring = False
        # Runs that the end of the server before cut short.
        self._interrupted: list[str] = []
        # One change of source, run, calibration or parameters at a time.
        self._lock = asyncio.Lock()
        self._background = Background()
        self.rings = RingDesk(
            engine,
            storage.folder,
            run=lambda: self.run,
            soon=self._background.start,
            automatic=ring_at_guard_stops,
            clock=clock,
        )
        self._drive_events = drive
        self._unsubscribe: Callable[[], None] = lambda: None
        self._unsubscribe_drive: Callable[[], None] = lambda: None
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
        self._background.start(self.watching.run())
        self._background.start(keep_telling(self.engine, lambda: self._run))
        self._background.start(asyncio.to_thread(self.history.purge))
        for run_id in self._interrupted:
            complete = partial(complete_recording, self.storage.folder, run_id)
            self._background.start(asyncio.to_thread(complete))
        self.driving.start()
        self._unsubscribe_drive = self._drive_events.subscribe(self.rings.drive_said)
        await self.engine.start()
        # An engine that was up before somebody listened.
        if self.engine.health.alive and self.engine.health.generation > self._generation:
            self._engine_started(self.engine.health.generation)

    async def stop(self) -> None:
        """End driving, the run, the engine and the database; safe to call twice and half-way."""
        # The robots stop first, while everything that hears of it is still there.
        await self.driving.stop()
        self._unsubscribe()
        self._unsubscribe_drive()
        await self._background.cancel()
        await self.calibrating.cancel()
        if self._run is not None:
            await self._close_run(RunState.INTERRUPTED, "the server was stopped during the run")
        await self.engine.stop()
        if self._started:
            await asyncio.to_thread(self.writer.stop)
        await asyncio.to_thread(self.storage.close)

    def _load(self) -> None:
        self.storage.open()
        self.run_files.quick.tidy()
        self.warnings.extend(self.storage.warnings)
        self._interrupted = [run.id for run in self.storage.mark_interrupted_runs()]
        warning = self.parameters.load()
        if warning is not None:
            self.warnings.append(warning)
        warning = self.rig.load()
        if warning is not None:
            self.warnings.append(warning)
        self.live_truth.load()
        calibration = calibration_of_cameras(self.storage, self._wanted.source)
        self._wanted = replace(
            self._wanted, calibration=calibration or self.storage.active_calibration()
        )

    # --- events ----------------------------------------------------------------------------

    def _on_event(self, event: Event) -> None:
        match event:
            case ObservationEvent():
                self._observed(event)
            case StateEvent():
                self._state_changed(event)
            case BoardLookEvent():
                # While calibrating nothing is observed; that it looks is as good a sign.
                self._fruitless_losses = 0
                self.calibrating.looked(event)
            case BoardViewsEvent():
                self.calibrating.views_changed(event)
            case SkippedFrameEvent():
                self.telemetry.frame_skipped(event)
            case DenseStereoEvent():
                if self.telemetry.dense_made(event, self.clock()):
                    self.followers.status_changed()
            case EngineStartedEvent():
                self._engine_started(event.generation)
            case EngineLostEvent():
                self._engine_lost(event)
            case _:
                pass

    def _observed(self, event: ObservationEvent) -> None:
        self.latest = event
        self._fruitless_losses = 0
        self.telemetry.observed(event, self.clock())
        if self._run is not None and event.run_id == self._run.id:
            self._run.observed(event, [role for role in ROLES if self.driving.is_driven(role)])
        self.driving.newest = event
        self.drive.observed(event)
        self.followers.observed(event)

    def _state_changed(self, event: StateEvent) -> None:
        if self._restoring and event.state is EngineState.IDLE:
            # A new engine has nothing open yet; until it has, what was lost is to be seen.
            return
        self.state = event
        self.driving.source_changed(event)
        playback = event.playback or {}
        run = self._run
        if run is not None and event.run_id == run.id and playback.get("ended"):
            self._background.start(self._finish_played_run(run))
        self.followers.status_changed()

    def _engine_started(self, generation: int) -> None:
        if generation <= self._generation:
            return
        self._generation = generation
        self.telemetry.new_engine()
        self.watching.engine_started()
        self._background.start(self._restore())

    def _engine_lost(self, event: EngineLostEvent) -> None:
        self._fruitless_losses += 1
        self._restoring = True
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

    def _circumstances(self) -> Circumstances:
        calibration = self._wanted.calibration
        return Circumstances.of(
            software=versions(),
            source=shown_spec(self._wanted.source),
            calibration=None if calibration is None else calibration.id,
            rig=self.rig.rig,
            guard=self.parameters.group("guard"),
        )

    async def _use(self, opening: Opening) -> None:
        await self._open(opening)
        self._wanted = opening
        self._fruitless_losses = 0
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
    ) -> str:
        """Have the engine open it; returns the text of the calibration that is used."""
        same = (self.state.source or {}).get("spec") == shown_spec(opening.source)
        command = opening.command(
            parameters or self.parameters.current,
            playback=self.state.playback if same else None,
            run_id=None if run is None else run.id,
            segment=segment,
            rig_yaml=self.rig.observed_text,
            record=None if run is None else record_order(self.storage.folder, run.record),
            truth=self.live_truth.order,
        )
        reply = await ask(self.engine, command, field=("body", "source"), timeout_s=_OPEN_TIMEOUT_S)
        self.telemetry.new_source()
        self.latest = self.driving.newest = None
        return str(reply["calibration_yaml"])

    async def _restore(self) -> None:
        """Have a new engine do what the lost one did; a run goes on as a new segment."""
        async with self._lock:
            run = self._run
            try:
                if self._fruitless_losses >= _MOST_FRUITLESS_LOSSES:
                    raise Conflict(
                        f"the engine ended {self._fruitless_losses} times in a row over "
                        f"{shown_spec(self.calibrating.source or self._wanted.source)}; choose "
                        f"another source"
                    )
                if self.calibrating.source is not None:
                    await self.calibrating.resume()
                elif run is None:
                    await self._restore_preview()
                else:
                    segment = run.segments
                    await self._open(self._wanted, run, segment=segment)
                    run.segments = max(run.segments, segment + 1)
            except NotAvailable as error:
                # This engine is gone as well; the next one is tried with the same.
                log.warning("not_restored", reason=str(error))
            except (FieldError, Conflict) as error:
                self._restoring = False
                if run is not None:
                    await self._close_run(RunState.FAILED, str(error))
                self.state = replace(self.state, state=EngineState.FAILED, reason=str(error))
            else:
                self._restoring = False
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

    async def _reopen(self) -> None:
        """Observe again what was open before something was calibrated."""
        try:
            await self._restore_preview()
        except (FieldError, Conflict, NotAvailable) as error:
            # Nothing of what was calibrated stays open behind it.
            await ask(self.engine, CloseSource())
            self.state = replace(self.state, state=EngineState.FAILED, reason=str(error))
        self.followers.status_changed()

    def _refuse_calibrating(self) -> None:
        if self.calibrating.source is not None:
            raise Conflict(
                "a calibration is being made; save it or leave it under Calibration first"
            )

    def _refuse_in_run(self, remedy: str) -> None:
        if self._run is not None:
            raise Conflict(f"the run {self._run.record.name} is going; {remedy}")

    # --- runs ------------------------------------------------------------------------------

    @property
    def run(self) -> RunRecord | None:
        """The run that is kept at this moment."""
        return None if self._run is None else self._run.snapshot()

    async def _finish_played_run(self, run: CurrentRun) -> None:
        async with self._lock:
            if self._run is run:
                await self._close_run(RunState.FINISHED, None)

    async def _close_run(self, state: RunState, reason: str | None) -> RunRecord:
        run = self._run
        assert run is not None
        if run.programme:
            with contextlib.suppress(NotAvailable, Conflict, FieldError):
                await self.driving.stop_programme()
        await tell_robots(self.engine, run)
        recording = await end_recording(self.engine, self._wanted)
        # A finished run tells why its recording is not whole.
        ended = run.ended(state, reason or recording.get("trouble"))
        write = partial(run.write_end, ended, recording.get("bytes"))
        try:
            written = await write_end(self.writer, write, run.id, self._background.start)
        finally:
            # Only now: until it is written, the database says that the run is going.
            self._run = None
        if state is RunState.FINISHED:
            self._background.start(self.truths.run_ended(run.record, self.live_truth.order))
        self.followers.status_changed()
        return written or ended
