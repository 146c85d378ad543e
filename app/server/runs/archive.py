"""Read access to stored runs; the current run appears in its present state."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path

from app.server.errors import Conflict, NotThere
from app.storage import IncidentRecord, RunRecord, SpeedRow, Storage
from observer.recording.run_folder import RECORDING

# A thousand would be an answer of 9 MB, which takes the server half a second to write.
MOST_RUNS = 200


class RunArchive:
    """Archive of the runs.

    Args:
        current: returns the run in progress, or None.
        rerunning: returns whether a run is a re-run whose recording is being written.
    """

    def __init__(
        self,
        storage: Storage,
        current: Callable[[], RunRecord | None],
        rerunning: Callable[[str], bool],
    ) -> None:
        self._storage = storage
        self._current = current
        self._rerunning = rerunning

    def is_going(self, run_id: str) -> bool:
        """Return whether this run is in progress, live or as a re-run."""
        current = self._current()
        return (current is not None and current.id == run_id) or self._rerunning(run_id)

    async def newest(self) -> list[RunRecord]:
        """Return the newest runs, at most ``MOST_RUNS``, newest first."""
        current = self._current()
        records = await asyncio.to_thread(self._storage.list_runs, limit=MOST_RUNS)
        return [current if current and record.id == current.id else record for record in records]

    async def find(self, run_id: str) -> RunRecord:
        """Return one run.

        Raises:
            NotThere: there is no run with that id, or it is deleted.
        """
        current = self._current()
        if current is not None and current.id == run_id:
            return current
        record = await asyncio.to_thread(self._storage.get_run, run_id)
        if record is None or record.deleted_at is not None:
            raise NotThere(f"there is no run {run_id[:80]!r}; it may have been deleted")
        return record

    async def recording(self, run_id: str) -> Path:
        """Return the path of a run's complete recording.

        Raises:
            NotThere: there is no such run, or it has no recording. Conflict: it is being written.
        """
        return await self._recording_of(await self.find(run_id))

    async def _recording_of(self, record: RunRecord) -> Path:
        if self._rerunning(record.id):
            raise Conflict(f"the re-run {record.name} is not finished; wait for it")
        if self.is_going(record.id):
            raise Conflict(f"the run {record.name} is in progress; stop it to get its recording")
        path = self._storage.folder.run(record.id) / RECORDING
        if not await asyncio.to_thread(path.is_file):
            raise NotThere(f"the run {record.name} has no recording")
        return path

    async def images(self, run_id: str) -> Path:
        """Return the recording with a run's images: its own, or that of the run it re-ran.

        Raises:
            NotThere: there is no such run, or no such recording. Conflict: it is being written.
        """
        record = asked = await self.find(run_id)
        while record.record == "none" and record.rerun_of is not None:
            before = await asyncio.to_thread(self._storage.get_run, record.rerun_of)
            if before is None:
                raise NotThere(
                    f"the run whose images {asked.name} uses has been permanently deleted"
                )
            record = before
        if record.record == "none":
            raise NotThere(
                f"the run {asked.name} was recorded without images, so it cannot be re-run"
            )
        return await self._recording_of(record)

    async def speeds(self, run_id: str) -> list[SpeedRow]:
        """Return all speeds of a run; of a run in progress, all but the last half second."""
        await self.find(run_id)
        return await asyncio.to_thread(self._storage.speeds, run_id)

    async def incidents(self, run_id: str) -> list[IncidentRecord]:
        """Return the incidents that stopped robots during a run, oldest first."""
        await self.find(run_id)
        return await asyncio.to_thread(self._storage.incidents, run_id)
