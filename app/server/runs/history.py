"""History of runs: search, annotation, deletion with undo."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterable
from dataclasses import replace
from datetime import timedelta
from functools import partial

import structlog

from app.contract.runs import DiskUse, History, Run
from app.contract.values import filled
from app.server.errors import NotThere
from app.server.runs.archive import RunArchive
from app.server.runs.current_run import CurrentRun
from app.storage import UNDO, RunRecord, Storage, StorageError, StorageMissing

log = structlog.get_logger(__name__)

# Seconds to cache the disk use: measuring it visits every file of the data folder, and typing a
# search requests it many times a second.
_DISK_AGE_S = 5.0


class RunHistory:
    """History of the runs.

    Args:
        current: returns the run in progress, or None. clock: monotonic seconds.
        undo: time during which a deleted run can be recovered.
        renamed: called when a run has been renamed.
    """

    def __init__(
        self,
        storage: Storage,
        archive: RunArchive,
        current: Callable[[], CurrentRun | None],
        clock: Callable[[], float],
        undo: timedelta = UNDO,
        *,
        renamed: Callable[[], Awaitable[None]],
    ) -> None:
        self._storage = storage
        self._archive = archive
        self._current = current
        self._clock = clock
        self._undo = undo
        self._renamed = renamed
        self._disk: tuple[float, DiskUse] | None = None

    async def page(
        self,
        text: str = "",
        tags: Iterable[str] = (),
        *,
        deleted: bool = False,
        limit: int = 50,
        offset: int = 0,
    ) -> History:
        """Return the runs with every word of the text in name, notes or tags, and with every tag.

        Args:
            deleted: return deleted but recoverable runs instead of the others.
        """
        find, tags = self._storage.find_runs, tuple(tags)
        found, all_tags = await asyncio.gather(
            asyncio.to_thread(find, text, tags=tags, deleted=deleted, limit=limit, offset=offset),
            asyncio.to_thread(self._storage.run_tags),
        )
        return History(
            runs=tuple(filled(Run, self._up_to_date(run)) for run in found.runs),
            total=found.total,
            tags=all_tags,
            disk=await self._disk_now(),
            undo_days=self._undo / timedelta(days=1),
        )

    async def annotate(
        self,
        run_id: str,
        *,
        name: str | None = None,
        tags: Iterable[str] | None = None,
        notes: str | None = None,
    ) -> RunRecord:
        """Change the given annotations of a run.

        Raises:
            NotThere: there is no run with that id, or it is deleted.
        """
        await self._archive.find(run_id)
        change = partial(self._storage.annotate_run, run_id, name=name, tags=tags, notes=notes)
        record = await self._of_storage(change, run_id)
        current = self._current()
        if current is not None and current.record.id == run_id:
            current.record = replace(
                current.record, name=record.name, tags=record.tags, notes=record.notes
            )
        if name is not None:
            await self._renamed()
        return self._up_to_date(record)

    async def discard(self, run_id: str) -> None:
        """Hide a run until it is recovered or purged.

        Raises:
            NotThere: there is no run with that id, or it is hidden already.
        """
        await self._archive.find(run_id)
        await self._of_storage(partial(self._storage.discard_run, run_id), run_id)

    async def recover(self, run_id: str) -> RunRecord:
        """Recover a hidden run.

        Raises:
            NotThere: there is no run with that id any more.
        """
        return await self._of_storage(partial(self._storage.recover_run, run_id), run_id)

    def purge(self) -> None:
        """Purge runs that were deleted too long ago to recover; in a worker thread."""
        try:
            gone = self._storage.purge(self._undo)
        except StorageError as error:
            # Repeated at the next start.
            log.warning("not_purged", reason=str(error))
        else:
            if gone:
                log.info("purged", runs=gone)

    async def _of_storage(self, change: Callable[[], RunRecord], run_id: str) -> RunRecord:
        try:
            return await asyncio.to_thread(change)
        except StorageMissing as error:
            raise NotThere(f"the run {run_id[:80]!r} no longer exists") from error

    def _up_to_date(self, record: RunRecord) -> RunRecord:
        current = self._current()
        return current.snapshot() if current and current.record.id == record.id else record

    async def _disk_now(self) -> DiskUse:
        now = self._clock()
        if self._disk is None or now - self._disk[0] > _DISK_AGE_S:
            use = await asyncio.to_thread(self._storage.folder.disk_use, self._storage.file)
            self._disk = now, DiskUse(use.total, use.free)
        return self._disk[1]
