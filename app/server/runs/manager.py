"""Manager of runs: the one in progress (start, end, re-run) and the stored ones."""

from __future__ import annotations

import asyncio
import contextlib
from functools import partial

from app.contract.drive import StartProgramme, StopProgramme
from app.contract.events import ObservationEvent, StateEvent
from app.contract.parameters import ParameterValues
from app.contract.values import LONGEST_NAME
from app.runtime.heap import return_freed_memory
from app.server.calibrations.library import keep_own_calibration
from app.server.errors import Conflict, FieldError, NotAvailable
from app.server.parameters.in_force import ParametersInForce
from app.server.parameters.manager import ParameterManager
from app.server.rig.store import RigStore
from app.server.robots import ArmedRobot, RobotManager
from app.server.runs.archive import RunArchive
from app.server.runs.comparing import MethodComparison
from app.server.runs.current_run import CurrentRun
from app.server.runs.ending import end_recording, write_end
from app.server.runs.files import RunFiles
from app.server.runs.frame_images import FrameImages
from app.server.runs.history import RunHistory
from app.server.runs.recording import (
    complete_recording,
    measure_run,
    record_order,
    tell_robots,
)
from app.server.runs.reruns import Reruns
from app.server.runs.saved_clips import SavedClips
from app.server.runs.truths import TruthFiles
from app.server.shared import Shared
from app.server.source.chosen_source import ChosenSource, choose_source
from app.server.source.hints import source_title
from app.server.source.live_truth import LiveTruthManager
from app.server.source.manager import SourceManager
from app.storage import RunRecord, RunState, StorageError
from app.versions import versions
from observer.opening import shown_spec
from observer.recording.payloads import Images
from observer.rig.rig import ROLES, Role
from observer.vision.swapped import swapped_reason

# Number of frames from its beginning within which a run ends if left and right are found swapped.
_FIRST_FRAMES = 30
# Interval; at most this much of the robots' data is lost with the server.
_TELL_S = 0.5


class RunManager:
    """Manager of at most one run at a time; used in the event loop.

    Attributes:
        running: the run in progress.
        archive, history, files, images: the stored runs. truths: ground truth added to them.
        reruns: re-runs of recordings.
        clips: saves clips of the last half minute. methods: compares two methods on the same
            frames.
    """

    def __init__(
        self,
        shared: Shared,
        source: SourceManager,
        parameters: ParameterManager,
        rig: RigStore,
        robots: RobotManager,
        live_truth: LiveTruthManager,
        *,
        clips_at_guard_stops: bool,
    ) -> None:
        """Set up without a run.

        Args:
            clips_at_guard_stops: whether a stop by the guard saves the last half minute.
        """
        storage = shared.storage
        self.running: CurrentRun | None = None
        self.archive = RunArchive(storage, lambda: self.current, self._is_rerunning)
        self.history = RunHistory(
            storage, self.archive, lambda: self.running, shared.clock, renamed=source.run_renamed
        )
        self.files = RunFiles(storage, self.archive)
        self.images = FrameImages(self.archive, storage.folder.run, shared.clock)
        self.truths = TruthFiles(storage, self.archive, self.files.quick)
        self.reruns = Reruns(shared, self.truths, self._robot_armed)
        self.clips = SavedClips(shared, automatic=clips_at_guard_stops)
        self.methods = MethodComparison(
            shared,
            source,
            parameters,
            rig,
            self.files,
            self.truths,
            self.clips,
            self._robot_armed,
        )
        self._shared = shared
        self._engine = shared.engine
        self._storage = storage
        self._writer = shared.writer
        self._soon = shared.background.start
        self._source = source
        self._parameters = parameters
        self._rig = rig
        self._robots = robots
        self._live_truth = live_truth
        # Runs cut short by the previous server's end.
        self._interrupted: list[str] = []

    @property
    def current(self) -> RunRecord | None:
        """Return the run in progress, in its present state."""
        return None if self.running is None else self.running.snapshot()

    # --- life cycle ------------------------------------------------------------------------

    def load(self) -> None:
        """Tidy up after a server that ended during a run; call it in a worker thread."""
        self.files.quick.tidy()
        self._interrupted = [run.id for run in self._storage.mark_interrupted_runs()]

    def begin(self) -> None:
        """Start the background work for runs, and finish what was left undone."""
        self._soon(self._keep_telling())
        self._soon(self.images.keep_tidy())
        self._soon(asyncio.to_thread(self.history.purge))
        for run_id in self._interrupted:
            self._soon(asyncio.to_thread(complete_recording, self._storage, run_id))
        self._soon(asyncio.to_thread(self._measure_older))

    def _measure_older(self) -> None:
        """Measure older runs that were stored without a length; in a worker thread."""
        for run_id in self._storage.unmeasured_runs():
            measure_run(self._storage, run_id)

    async def _keep_telling(self) -> None:
        while True:
            await asyncio.sleep(_TELL_S)
            if self.running is not None:
                await tell_robots(self._engine, self.running.robots)

    # --- starting --------------------------------------------------------------------------

    async def start(
        self,
        *,
        name: str | None,
        source: str | None,
        calibration_id: str | None,
        preset: str | None,
        parameters: ParameterValues,
        programme: StartProgramme | None = None,
        record: Images = "jpeg",
    ) -> RunRecord:
        """Record observations from now on, from the source's beginning.

        Args:
            record: images to record.
            source: the open source if left out. calibration_id: if left out, the source's own,
                or the one in use if the source is left out too.
            programme: programme that starts right after the run and ends with it.

        Raises:
            Conflict: a run is in progress, or the programme cannot be driven. FieldError,
                ParameterError: a value is refused; nothing was changed.
            NotAvailable, StorageError: it is impossible now, and nothing was changed;
                ``StorageFull`` also if the disk has no room for a recording.
        """
        async with self._shared.lock:
            self._shared.refuse_in_run("stop it first")
            self._shared.refuse_calibrating()
            armed: dict[Role, ArmedRobot] = {}
            if programme is not None:
                armed = self._robots.rearming.armed_robots(programme)
            if source is None and calibration_id is None:
                self._refuse_swapped()
            revision = self._parameters.plan(preset, parameters)
            chosen = self._source.wanted
            if source is not None or calibration_id is not None:
                chosen = await asyncio.to_thread(
                    choose_source, self._storage, source or chosen.source, calibration_id
                )
            created = await self._create(name, chosen, revision.after, record)
            run = self.running = CurrentRun(
                created, self._storage, self._writer, self._shared.clock
            )
            try:
                text = await self._observe(chosen, run, parameters=revision.after)
                if chosen.calibration is None:
                    await self._keep_own_calibration(chosen, text, run)
            except BaseException:
                self.running = None
                await self._forget(created.id)
                raise
            self._source.wanted = chosen
            self._parameters.adopt(revision, 0, run.id)
            if programme is not None:
                await self._start_programme(run, programme, armed)
            self._shared.followers.status_changed()
            return run.snapshot()

    def _refuse_swapped(self) -> None:
        latest = self._source.latest
        reason = None if latest is None else swapped_reason(latest.line["reasons"])
        if reason is not None:
            raise Conflict(f"{reason}; open the source with its cameras swapped")

    async def _create(
        self,
        name: str | None,
        chosen: ChosenSource,
        parameters: ParametersInForce,
        record: Images,
    ) -> RunRecord:
        return await asyncio.to_thread(
            self._storage.create_run,
            name=(name or chosen.name or source_title(chosen.source))[:LONGEST_NAME],
            source=shown_spec(chosen.source),
            parameters=parameters.values.flat(),
            versions=versions(),
            calibration_id=None if chosen.calibration is None else chosen.calibration.id,
            preset=parameters.preset,
            rig=self._rig.observed_text,
            record=record,
        )

    async def _observe(
        self,
        chosen: ChosenSource,
        run: CurrentRun,
        *,
        segment: int = 0,
        parameters: ParametersInForce | None = None,
    ) -> str:
        return await self._source.observe(
            chosen,
            run_id=run.id,
            segment=segment,
            record=record_order(self._storage.folder, run.record),
            parameters=parameters,
        )

    async def _keep_own_calibration(self, chosen: ChosenSource, text: str, run: CurrentRun) -> None:
        try:
            run.record = await asyncio.to_thread(
                keep_own_calibration, self._storage, text, run.record
            )
        except BaseException:
            # The source did open: the engine records the run that is about to be deleted.
            await end_recording(self._engine, chosen)
            raise

    async def _start_programme(
        self, run: CurrentRun, programme: StartProgramme, armed: dict[Role, ArmedRobot]
    ) -> None:
        """Start a run's programme; if that fails, the run does not start."""
        try:
            await self._robots.rearming.arm_again(programme, armed)
            await self._robots.ask(programme)
        except BaseException:
            await self.close(RunState.FAILED, "its programme could not be run")
            await self._forget(run.id)
            raise
        run.programme = True

    async def _forget(self, run_id: str) -> None:
        """Delete a run that never started."""
        with contextlib.suppress(NotAvailable, StorageError):
            await self._writer.submit(partial(self._storage.delete_run, run_id), timeout_s=2.0)

    async def rerun(
        self, run_id: str, *, name: str | None, preset: str | None, parameters: ParameterValues
    ) -> RunRecord:
        """Begin to observe a run's recording again in a worker, as a new run without images.

        Ground truth added to the original run is added to the new one after its end.

        Args:
            preset: None for the run's initial parameters.
            parameters: changes to these.

        Raises:
            NotThere: there is no such run, or it has no images. Conflict: it is in progress.
            FieldError, ParameterError: a value is refused.
            NotAvailable, StorageError: as for ``Reruns.start``.
        """
        original = await self.archive.find(run_id)
        images = await self.archive.images(run_id)
        chosen = self._parameters.compose(preset, original.parameters, parameters)
        return await self.reruns.start(original, images, name, chosen)

    def _is_rerunning(self, run_id: str) -> bool:
        return self.reruns.is_recording(run_id)

    def _robot_armed(self) -> bool:
        return self._robots.any_driven()

    async def resume(self) -> None:
        """Continue the run with a new engine, as a new segment."""
        run = self.running
        assert run is not None
        segment = run.segments
        await self._observe(self._source.wanted, run, segment=segment)
        run.resumed(segment)

    # --- during a run ----------------------------------------------------------------------

    def observed(self, event: ObservationEvent) -> None:
        """Handle the observation of a frame."""
        run = self.running
        if run is not None and event.run_id == run.id:
            if run.frames < _FIRST_FRAMES:
                self._end_swapped(run, event)
            run.observed(event, [role for role in ROLES if self._robots.is_driven(role)])

    def state_changed(self, event: StateEvent) -> None:
        """End the run when the source that it plays ends."""
        run = self.running
        playback = event.playback
        if run is not None and event.run_id == run.id and playback and playback.ended:
            self._soon(self._end(run, RunState.FINISHED, None))

    # --- ending ----------------------------------------------------------------------------

    async def stop(self, run_id: str) -> RunRecord:
        """End the run; its source stays open.

        Raises:
            NotThere: there is no such run. Conflict: it has ended already, or is a re-run.
        """
        if self.reruns.is_going(run_id):
            raise Conflict("a re-run cannot be stopped half-way; delete it to cancel it")
        async with self._shared.lock:
            if self.running is None or self.running.id != run_id:
                record = await self.archive.find(run_id)
                raise Conflict(f"the run “{record.name}” was already stopped and saved")
            return await self.close(RunState.FINISHED, None)

    async def delete(self, run_id: str) -> None:
        """Hide a run that has ended; ``history.recover`` brings it back.

        A re-run in progress is cancelled and permanently deleted.
        """
        if self.reruns.is_going(run_id):
            await self.reruns.cancel(run_id)
            return
        async with self._shared.lock:
            if self.running is not None and self.running.id == run_id:
                self._shared.refuse_in_run("stop it before you delete it")
            await self.history.discard(run_id)

    def _end_swapped(self, run: CurrentRun, event: ObservationEvent) -> None:
        """End a run whose cameras are swapped: its measurements would be meaningless."""
        reason = swapped_reason(event.line["reasons"])
        if reason is not None:
            self._soon(self._end(run, RunState.FAILED, reason))

    async def _end(self, run: CurrentRun, state: RunState, reason: str | None) -> None:
        async with self._shared.lock:
            if self.running is run:
                await self.close(state, reason)

    async def close(self, state: RunState, reason: str | None) -> RunRecord:
        """End the run in progress; call this with the shared lock held, or at shutdown.

        Args:
            reason: one sentence on why it ended; None for a regular end.
        """
        run = self.running
        assert run is not None
        if run.programme:
            with contextlib.suppress(NotAvailable, Conflict, FieldError):
                await self._robots.ask(StopProgramme())
        await tell_robots(self._engine, run.robots)
        recording = await end_recording(self._engine, self._source.wanted)
        # A finished run says why its recording is incomplete.
        ended = run.ended(state, reason or (None if recording is None else recording.trouble))
        size = None if recording is None else recording.bytes
        write = partial(run.write_end, ended, size)
        try:
            written = await write_end(self._writer, write, run.id, self._soon)
        finally:
            # Not earlier: until the end is written, the database says that the run is in progress.
            self.running = None
        if run.replaced or recording is None:
            # A lost engine had observed more frames than its recording holds.
            self._soon(asyncio.to_thread(measure_run, self._storage, run.id))
        if state is RunState.FINISHED:
            self._soon(self.truths.run_ended(run.record, self._live_truth.order))
        self._soon(asyncio.to_thread(return_freed_memory))
        self._shared.followers.status_changed()
        return written or ended
