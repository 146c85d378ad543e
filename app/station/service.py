"""The station: what the server does when it is asked, apart from how it is asked.

It owns the engine, the database, the parameters, the open source and the run that is kept. One
change at a time: every method that changes something holds the station's lock.
"""

from __future__ import annotations

import asyncio
import contextlib
from dataclasses import replace
from functools import partial
from typing import Any

from app.messages import EngineState, SetPlayback
from app.parameter_store import ParametersInForce
from app.station.archive import no_such_run
from app.station.asking import ask
from app.station.calibrations import find_calibration, keep_own_calibration
from app.station.core import StationCore
from app.station.current_run import CurrentRun, versions
from app.station.errors import Conflict, NotAvailable
from app.station.opening import make_opening
from app.storage import RunRecord, RunState, StorageError


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
            opening = await asyncio.to_thread(make_opening, self.storage, source, calibration_id)
            await self._use(opening)

    async def play(self, change: SetPlayback) -> dict[str, Any]:
        """Change the playback and return it as it is then."""
        return await ask(self.engine, change)

    # --- runs ------------------------------------------------------------------------------

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
                text = await self._open(opening, run, parameters=revision.after)
                if opening.calibration is None:
                    run.record = await asyncio.to_thread(
                        keep_own_calibration, self.storage, text, record
                    )
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
