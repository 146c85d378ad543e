"""Making calibrations from cameras or images, and using stored ones."""

from __future__ import annotations

import asyncio
import contextlib
from dataclasses import replace
from pathlib import Path

from app.contract.calibrating import Calibration
from app.contract.commands import ChangeCalibration
from app.contract.events import EngineState
from app.contract.values import of_plain, plain
from app.server.calibrating.session import CalibrationSession
from app.server.calibrations.library import calibration_facts, find_calibration
from app.server.errors import Conflict, FieldError, NotAvailable
from app.server.shared import Shared
from app.server.source.camera_match import bound_cameras
from app.server.source.chosen_source import ChosenSource, check_spec
from app.server.source.manager import SourceManager
from app.storage import CalibrationRecord
from app.workers.calibration.image_archive import check_archive
from app.workers.calibration.messages import FindBoards
from observer.calibration.boards.board import Board
from observer.calibration.formats.opencv_file import read_calibration


class CalibrationManager:
    """Manager of calibrations; used in the event loop.

    Attributes:
        session: the calibration in progress.
    """

    def __init__(self, shared: Shared, source: SourceManager) -> None:
        self.session = CalibrationSession(shared)
        self._shared = shared
        self._storage = shared.storage
        self._source = source

    # --- making a calibration --------------------------------------------------------------

    async def begin(self, source: str | None, board: Board) -> None:
        """Look for a board in the images of a source; None stands for the open source.

        Raises:
            Conflict: a run is in progress. FieldError: the source cannot be opened; the previous
                one stays open. NotAvailable: there is no engine at the moment.
        """
        async with self._shared.lock:
            self._shared.refuse_in_run("stop it before you calibrate")
            source = source or self.session.source or self._source.wanted.source
            check_spec(source)
            await self.session.begin(source, board)
            self._source.fruitless_losses = 0

    async def end(self) -> None:
        """Discard the captured views and observe the previous source again."""
        async with self._shared.lock:
            live = self.session.source is not None
            await self.session.end()
            if live:
                await self._source.reopen()

    async def swap(self) -> None:
        """Swap left and right from now on, and in the views captured so far.

        Raises:
            Conflict: no cameras are being calibrated. FieldError: they cannot be opened again.
        """
        async with self._shared.lock:
            await self.session.swap()

    async def change(self, command: ChangeCalibration) -> None:
        """Capture, undo or remove; see ``CalibrationSession.change``."""
        async with self._shared.lock:
            await self.session.change(command)

    async def take_images(self, archive: Path, board: Board) -> None:
        """Find the board in uploaded images and continue with the result.

        Args:
            archive: a ZIP file; it is not changed.

        Raises:
            CalibrationError: the archive cannot be used; earlier views are kept.
            Conflict: a computation is running, or this one was cancelled.
        """
        await asyncio.to_thread(check_archive, archive)
        found = await self.session.computation.find_boards(FindBoards(archive, board))
        async with self._shared.lock:
            live = self.session.source is not None
            await self.session.take_images(found, board)
            if live:
                await self._source.reopen()

    async def save(self, name: str, *, activate: bool) -> CalibrationRecord:
        """Store the computed calibration; with ``activate``, use it for its cameras from now on.

        Raises:
            Conflict: nothing has been computed. StorageError: it could not be stored.
            FieldError, NotAvailable: it was stored, but cannot be used now. Whatever is raised, the
                captured views and the result are kept.
        """
        async with self._shared.lock:
            record = await asyncio.to_thread(self._keep, name)
            if not activate:
                return record
            if self.session.source is None:
                chosen = replace(self._source.wanted, calibration=record)
            else:
                chosen = ChosenSource(self.session.source, record)
            kept = f"{record.name} is saved, but not in use"
            try:
                await self._source.use(chosen)
            except (FieldError, Conflict) as error:
                raise FieldError(("body", "activate"), f"{kept}: {error}") from error
            except NotAvailable as error:
                raise NotAvailable(f"{kept}: {error}") from error
            await self.session.end()
            return record

    def _keep(self, name: str) -> CalibrationRecord:
        """Store the calibration with its report and its cameras."""
        fitted, cameras = self.session.computation.finished.fitted, self.session.cameras
        calibration = read_calibration(fitted.calibration_yaml, name=name)
        info = {
            **calibration_facts(calibration),
            "origin": "calibrated here",
            "report": fitted.report,
            "bound": plain(cameras),
        }
        return self._storage.save_calibration(fitted.calibration_yaml, name=name, info=info)

    # --- stored calibrations ---------------------------------------------------------------

    def entry(self, record: CalibrationRecord) -> Calibration:
        """Return a calibration as it is listed."""
        active = self._source.wanted.calibration
        known = {
            "id": record.id,
            "name": record.name,
            "created_at": record.created_at,
            "active": active is not None and active.id == record.id,
            "devices": bound_cameras(record).devices,
        }
        with contextlib.suppress(ValueError):
            return of_plain(Calibration, known | record.info)
        # The record was damaged by hand: the calibration's own text has the essential facts.
        facts = calibration_facts(read_calibration(record.text, name=record.name))
        notes = ["the additional data stored with this calibration is damaged and ignored"]
        return of_plain(Calibration, known | facts | {"notes": notes})

    async def activate(self, id: str | None) -> None:
        """Use this calibration for the open source; None restores the source's own.

        Raises:
            Conflict: a run is in progress. FieldError: it does not fit the source's images.
        """
        async with self._shared.lock:
            self._shared.refuse_in_run("stop it before you change the calibration")
            self._shared.refuse_calibrating()
            record = None
            if id is not None:
                record = await asyncio.to_thread(find_calibration, self._storage, id)
            wanted, state = self._source.wanted, self._source.state.state
            if record == wanted.calibration and state is EngineState.PREVIEW:
                return
            await self._source.use(replace(wanted, calibration=record))

    async def rename(self, id: str, name: str) -> CalibrationRecord:
        """Rename a listed calibration."""
        async with self._shared.lock:
            await asyncio.to_thread(find_calibration, self._storage, id)
            record = await asyncio.to_thread(self._storage.change_calibration, id, name=name)
            wanted = self._source.wanted
            if wanted.calibration is not None and wanted.calibration.id == id:
                self._source.wanted = replace(wanted, calibration=record)
        self._shared.followers.status_changed()
        return record

    async def delete(self, id: str) -> None:
        """Remove a calibration from the list."""
        async with self._shared.lock:
            active = self._source.wanted.calibration
            if active is not None and active.id == id:
                raise Conflict(f"the calibration {active.name} is in use; deactivate it first")
            await asyncio.to_thread(find_calibration, self._storage, id)
            await asyncio.to_thread(self._storage.delete_calibration, id)
