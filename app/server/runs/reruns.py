"""Re-runs: the recordings of runs, processed again by workers in the background."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import msgspec
import structlog

from app.contract.status import RerunStatus
from app.contract.values import filled
from app.runtime.jobs import Progress
from app.runtime.worker import JobFailed
from app.server.data_files import storage_errors
from app.server.errors import NotAvailable
from app.server.parameters.in_force import ParametersInForce
from app.server.runs.ending import write_end
from app.server.runs.result_rows import result_rows
from app.server.runs.truths import TruthFiles
from app.server.shared import Shared
from app.storage import RunRecord, RunState, StorageError, StorageFull
from app.versions import versions
from app.workers.rerun.messages import Rerun, Rerunned
from app.workers.rerun.process import rerun_in_worker
from observer.errors import DynamicObserverError
from observer.recording.run_folder import RECORDING

log = structlog.get_logger(__name__)

State = Literal["waiting", "observing", "finishing"]

_MOST_GOING = 8
# A recording without images is far smaller; this much space stays free.
_SPARE_BYTES = 100 << 20
_RESULTS = ".results.jsonl"


@dataclass(eq=False)
class _Going:
    """Unfinished re-run.

    Attributes:
        share: share of the frames observed so far. recorded: whether its recording is complete.
    """

    record: RunRecord
    task: asyncio.Task[None] | None = None
    state: State = "waiting"
    share: float = 0.0
    recorded: bool = False


class Reruns:
    """Runs one re-run after the other; used in the event loop.

    Neither the open source nor the current parameters change, and a live run continues.

    Args:
        held: returns whether a re-run must be suspended because a robot is armed.
    """

    def __init__(self, shared: Shared, truths: TruthFiles, held: Callable[[], bool]) -> None:
        self._shared = shared
        self._storage = shared.storage
        self._writer = shared.writer
        self._truths = truths
        self._held = held
        self._one = asyncio.Lock()
        self._going: dict[str, _Going] = {}

    def facts(self) -> list[RerunStatus]:
        """Return the unfinished re-runs, in the order of their start."""
        held = self._held()
        return [
            filled(
                RerunStatus,
                going.record,
                state="held" if held and going.state == "observing" else going.state,
                share=round(going.share, 3),
            )
            for going in self._going.values()
        ]

    def is_going(self, run_id: str) -> bool:
        """Return whether this run is a re-run in progress."""
        return run_id in self._going

    def is_recording(self, run_id: str) -> bool:
        """Return whether this run is a re-run whose recording is being written."""
        going = self._going.get(run_id)
        return going is not None and not going.recorded

    async def start(
        self, original: RunRecord, images: Path, name: str | None, parameters: ParametersInForce
    ) -> RunRecord:
        """Begin to observe a recording again, as a new run.

        Args:
            original: the run to re-run. images: the recording that holds its images.

        Raises:
            NotAvailable: too many are waiting. StorageFull: there is no room for its recording.
            FieldError, StorageError: it cannot be written.
        """
        if len(self._going) >= _MOST_GOING:
            raise NotAvailable(
                f"{_MOST_GOING} re-runs are waiting already; wait for one, or cancel it"
            )
        if await asyncio.to_thread(self._storage.folder.free_bytes) < _SPARE_BYTES:
            raise StorageFull("no space is left for the re-run; free some disk space")
        values = parameters.values.flat()
        record = await asyncio.to_thread(
            self._storage.create_run,
            name=name or f"{original.name[:90]} (re-run)",
            source=original.source,
            parameters=values,
            versions=versions(),
            calibration_id=original.calibration_id,
            preset=parameters.preset,
            rig=original.rig,
            record="none",
            rerun_of=original.id,
        )
        folder = self._storage.folder.run(record.id).absolute()
        try:
            with storage_errors(folder):
                await asyncio.to_thread(folder.mkdir, parents=True, exist_ok=True)
        except DynamicObserverError:
            await self._forget(record.id)
            raise
        job = Rerun(
            images=str(images.absolute()),
            output=str(folder / RECORDING),
            results=str(folder / _RESULTS),
            id=record.id,
            name=record.name,
            preset=record.preset,
            versions=record.versions,
            parameters=values,
            rig_yaml=record.rig,
        )
        going = self._going[record.id] = _Going(record)
        going.task = asyncio.create_task(self._run(going, job), name=f"re-run {record.id}")
        self._shared.followers.status_changed()
        return record

    async def cancel(self, run_id: str) -> None:
        """Cancel a re-run in progress and delete it; do nothing if it is not in progress."""
        if (going := self._going.get(run_id)) is None:
            return
        await _ended(going)
        await self._forget(run_id)

    async def close(self) -> None:
        """End all re-runs; they are kept as interrupted runs."""
        for going in tuple(self._going.values()):
            await _ended(going)
            if going.recorded:
                continue
            self._writer.post(
                partial(
                    self._storage.update_run,
                    going.record.id,
                    state=RunState.INTERRUPTED,
                    reason="the server was stopped during the re-run",
                )
            )

    async def _run(self, going: _Going, job: Rerun) -> None:
        results = Path(job.results)
        try:
            async with self._one:
                going.state = "observing"
                self._shared.followers.status_changed()
                try:
                    done = await rerun_in_worker(job, partial(self._heard, going), self._held)
                    going.state, going.share = "finishing", 1.0
                    self._shared.followers.status_changed()
                    await self._keep_speeds(going.record.id, results)
                except (
                    JobFailed,
                    StorageError,
                    NotAvailable,
                    OSError,
                    msgspec.MsgspecError,
                ) as error:
                    log.warning("rerun_failed", run=going.record.id, reason=str(error))
                    await self._end(going, state=RunState.FAILED, reason=str(error))
                else:
                    await self._finish(going, done)
        finally:
            with contextlib.suppress(OSError):
                results.unlink(missing_ok=True)
            self._going.pop(going.record.id, None)
            self._shared.followers.status_changed()

    def _heard(self, going: _Going, progress: Progress) -> None:
        going.share = progress.share
        self._shared.followers.status_changed()

    async def _keep_speeds(self, run_id: str, results: Path) -> None:
        batches = result_rows(run_id, results)
        while (rows := await asyncio.to_thread(next, batches, None)) is not None:
            await self._writer.submit(partial(self._storage.append_speeds, rows), timeout_s=60.0)

    async def _finish(self, going: _Going, done: Rerunned) -> None:
        lost = f"the images of {done.lost} frames could not be read" if done.lost else None
        await self._end(
            going,
            state=RunState.FINISHED,
            frames=done.frames,
            segments=done.segments,
            begin_s=done.begin_s,
            duration_s=done.duration_s,
            recording_bytes=done.bytes,
            reason=lost,
        )
        await self._truths.run_ended(going.record, None)

    async def _end(self, going: _Going, **values: Any) -> None:
        write = partial(self._storage.update_run, going.record.id, **values)
        await write_end(self._writer, write, going.record.id, self._shared.background.start)
        going.recorded = True

    async def _forget(self, run_id: str) -> None:
        """Delete a run that failed to start or was cancelled."""
        with contextlib.suppress(NotAvailable, StorageError):
            await self._writer.submit(partial(self._storage.delete_run, run_id))


async def _ended(going: _Going) -> None:
    assert going.task is not None
    going.task.cancel()
    await asyncio.gather(going.task, return_exceptions=True)
