"""The station: what the server does when it is asked, apart from how it is asked.

It owns the engine, the database, the parameters, the open source and the run that is kept. One
change at a time: every method that changes something holds the station's lock.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, Literal

from app.drive.messages import StartProgramme
from app.engine.playback import MAX_RATE
from app.messages import ChangeCalibration, EngineState, LiveTruthOrder, SetPlayback
from app.parameter_store import ParametersInForce
from app.server.asking import ask
from app.server.calibrating.library import find_calibration, keep_made, keep_own_calibration
from app.server.core import StationCore
from app.server.errors import Conflict, FieldError, NotAvailable
from app.server.runs.current_run import CurrentRun
from app.server.source.opening import Opening, check_spec, make_opening
from app.storage import CalibrationRecord, RunRecord, RunState, StorageError
from app.versions import versions
from app.workers.calibration.messages import FindBoards
from observer.calibration.board import Board
from observer.opening import shown_spec
from observer.rig.rig import Rig


class Station(StationCore):
    """See the module; the constructor and the attributes are those of ``StationCore``."""

    # --- source ----------------------------------------------------------------------------

    async def open_source(self, source: str, calibration_id: str | None) -> None:
        """Show another source.

        Raises:
            Conflict: a run is going. FieldError: the source or calibration cannot be used;
                what was open stays open. NotAvailable: there is no engine at the moment.
        """
        async with self._lock:
            self._refuse_in_run("stop it before you open another source")
            self._refuse_calibrating()
            opening = await asyncio.to_thread(make_opening, self.storage, source, calibration_id)
            await self._use(opening)

    async def play(self, change: SetPlayback) -> dict[str, Any]:
        """Change the playback and return it as it is then."""
        return await ask(self.engine, change)

    async def choose_live_truth(self, order: LiveTruthOrder | None) -> dict[str, Any] | None:
        """Listen to this from now on; see ``TruthDesk.choose``."""
        async with self._lock:
            return await self.live_truth.choose(order)

    # --- runs ------------------------------------------------------------------------------

    async def start_run(
        self,
        *,
        name: str | None,
        source: str | None,
        calibration_id: str | None,
        preset: str | None,
        parameters: dict[str, Any],
        programme: StartProgramme | None = None,
        record: Literal["none", "jpeg", "lossless"] = "jpeg",
        rerun_of: str | None = None,
    ) -> RunRecord:
        """Keep what is observed from now on, from the source's beginning.

        Args:
            record: which images the recording keeps.
            source: what is open if left out. calibration_id: the source's own if left out
                together with a source, otherwise the one in use.
            programme: started once the run has begun, and ended with it.
            rerun_of: the run whose recording ``source`` is, played as fast as it goes.

        Raises:
            Conflict: a run is going, or the programme cannot be driven. FieldError,
                ParameterError: nothing was changed.
            NotAvailable, StorageError: nothing was changed; ``StorageFull`` also where the disk
                has no room for a recording.
        """
        async with self._lock:
            self._refuse_in_run("stop it first")
            self._refuse_calibrating()
            if programme is not None:
                self.driving.check_programme(programme)
            revision = self.parameters.plan(preset, parameters)
            opening = self._wanted
            if source is not None or calibration_id is not None:
                opening = await asyncio.to_thread(
                    make_opening, self.storage, source or self._wanted.source, calibration_id
                )
            opening = replace(opening, run_rate=None if rerun_of is None else MAX_RATE)
            created = await asyncio.to_thread(
                partial(
                    self.storage.create_run,
                    name=name or f"Run of {shown_spec(opening.source)}"[:100],
                    source=shown_spec(opening.source),
                    parameters=dict(revision.after.values.flat()),
                    versions=versions(),
                    calibration_id=None if opening.calibration is None else opening.calibration.id,
                    preset=revision.after.preset,
                    rig=self.rig.observed_text,
                    record=record,
                    rerun_of=rerun_of,
                )
            )
            run = self._run = CurrentRun(created, self.storage, self.writer, self.clock)
            try:
                text = await self._open(opening, run, parameters=revision.after)
                if opening.calibration is None:
                    run.record = await asyncio.to_thread(
                        keep_own_calibration, self.storage, text, created
                    )
            except BaseException:
                self._run = None
                await self._forget(created.id)
                raise
            self._wanted = opening
            self.parameters.adopt(revision, 0, run.id)
            if programme is not None:
                await self._start_programme(run, programme)
            self.followers.status_changed()
            return run.snapshot()

    async def _start_programme(self, run: CurrentRun, programme: StartProgramme) -> None:
        """Have a run's programme driven; a run that cannot begin with it does not begin."""
        try:
            await self.driving.arm_again(programme)
            await self.driving.start_programme(programme)
        except BaseException:
            await self._close_run(RunState.FAILED, "its programme could not be driven")
            await self._forget(run.id)
            raise
        run.programme = True

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

    async def rerun(
        self, run_id: str, *, name: str | None, preset: str | None, parameters: dict[str, Any]
    ) -> RunRecord:
        """Observe a run's recording again, once through, without keeping its images twice.

        Where truth was laid over the run, it is laid over the new one when that has ended.

        Args:
            preset: None for the parameters that the run began with; those of the guard stay as
                they are. parameters: made to these.

        Raises:
            NotThere: there is no such run, or none of its images. As ``start_run``.
        """
        original = await self.runs.find(run_id)
        recording = await self.runs.images(run_id)
        if preset is None:
            known = self.parameters.current.values.vision.flat()
            own = {key: value for key, value in original.parameters.items() if key in known}
            parameters = {**own, **parameters}
        return await self.start_run(
            name=name or f"{original.name}, observed again"[:100],
            source=str(recording),
            calibration_id=None,
            preset=preset,
            parameters=parameters,
            record="none",
            rerun_of=run_id,
        )

    async def delete_run(self, run_id: str) -> None:
        """Hide a run that has ended; ``history.recover`` has it back."""
        async with self._lock:
            if self._run is not None and self._run.id == run_id:
                self._refuse_in_run("stop it before you delete it")
            await self.history.discard(run_id)

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

    # --- calibrating -----------------------------------------------------------------------

    async def begin_calibration(self, source: str | None, board: Board) -> None:
        """Look for a board in the images of a source; None is what is open.

        Raises:
            Conflict: a run is going. FieldError: the source cannot be opened; what was open
                stays open. NotAvailable: there is no engine at the moment.
        """
        async with self._lock:
            self._refuse_in_run("stop it before you calibrate")
            source = source or self.calibrating.source or self._wanted.source
            check_spec(source)
            await self.calibrating.begin(source, board)
            self._fruitless_losses = 0

    async def end_calibration(self) -> None:
        """Forget what was captured and observe again what was open before."""
        async with self._lock:
            live = self.calibrating.source is not None
            await self.calibrating.end()
            if live:
                await self._reopen()

    async def swap_cameras(self) -> None:
        """Take left for right from now on, in the views so far as well.

        Raises:
            Conflict: no cameras are calibrated. FieldError: they cannot be opened again.
        """
        async with self._lock:
            await self.calibrating.swap()

    async def change_calibration(self, command: ChangeCalibration) -> None:
        """Capture, undo, remove; see ``CalibrationDesk.change``."""
        async with self._lock:
            await self.calibrating.change(command)

    async def calibrate_images(self, job: FindBoards) -> None:
        """Find the board in images that were sent in, and go on with what was found.

        Raises:
            CalibrationError: the archive cannot be used; nothing is forgotten then.
            Conflict: a computation is going, or it was cancelled.
        """
        found = await self.calibrating.find_boards(job)
        async with self._lock:
            live = self.calibrating.source is not None
            await self.calibrating.take_images(found, job.board)
            if live:
                await self._reopen()

    async def save_calibration(self, name: str, *, activate: bool) -> CalibrationRecord:
        """Keep the computed calibration; ``activate`` observes its cameras with it from now on.

        Raises:
            Conflict: nothing has been computed. StorageError: it could not be kept.
            FieldError, NotAvailable: it is kept, but cannot be used now. Whatever is raised, what
                was captured and computed stays.
        """
        async with self._lock:
            desk = self.calibrating
            record = await asyncio.to_thread(keep_made, self.storage, desk, name)
            if not activate:
                return record
            if desk.source is None:
                opening = replace(self._wanted, calibration=record)
            else:
                opening = Opening(desk.source, record)
            kept = f"{record.name} is saved, but not in use"
            try:
                await self._use(opening)
            except (FieldError, Conflict) as error:
                raise FieldError(("body", "activate"), f"{kept}: {error}") from error
            except NotAvailable as error:
                raise NotAvailable(f"{kept}: {error}") from error
            await desk.end()
            return record

    # --- rig -------------------------------------------------------------------------------

    async def change_rig(self, changed: Callable[[], Rig]) -> None:
        """Put a rig into force; the open source begins again with it, where it would differ.

        Robots whose port or model is another are connected anew, disarmed.

        Args:
            changed: makes it of the one in force, which nobody else changes meanwhile.

        Raises:
            Conflict: a run or a calibration is going, and it would be observed otherwise.
            FieldError: as ``changed`` raises, or it cannot be written.
        """
        async with self._lock:
            rig = changed()
            alike = self.rig.observes_alike(rig)
            if not alike:
                self._refuse_in_run("stop it before you change the rig")
                self._refuse_calibrating()
            await asyncio.to_thread(self.rig.keep, rig)
            self.driving.rig_changed(self.state)
            if not alike and self.state.state is EngineState.PREVIEW:
                await self._restore_preview()
        self.followers.status_changed()

    # --- calibrations ----------------------------------------------------------------------

    async def activate_calibration(self, id: str | None) -> None:
        """Use this calibration with the open source; None goes back to the source's own.

        Raises:
            Conflict: a run is going. FieldError: it does not fit the source's images.
        """
        async with self._lock:
            self._refuse_in_run("stop it before you change the calibration")
            self._refuse_calibrating()
            record = None
            if id is not None:
                record = await asyncio.to_thread(find_calibration, self.storage, id)
            if record == self._wanted.calibration and self.state.state is EngineState.PREVIEW:
                return
            await self._use(replace(self._wanted, calibration=record))

    async def rename_calibration(self, id: str, name: str) -> CalibrationRecord:
        """Call a listed calibration by another name."""
        async with self._lock:
            await asyncio.to_thread(find_calibration, self.storage, id)
            rename = partial(self.storage.change_calibration, id, name=name)
            record = await asyncio.to_thread(rename)
            if self._wanted.calibration is not None and self._wanted.calibration.id == id:
                self._wanted = replace(self._wanted, calibration=record)
        self.followers.status_changed()
        return record

    async def delete_calibration(self, id: str) -> None:
        """Take a calibration off the list."""
        async with self._lock:
            active = self._wanted.calibration
            if active is not None and active.id == id:
                raise Conflict(f"the calibration {active.name} is in use; deactivate it first")
            await asyncio.to_thread(find_calibration, self.storage, id)
            await asyncio.to_thread(self.storage.delete_calibration, id)
