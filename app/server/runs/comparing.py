"""Comparison of two methods: a worker observes the same frames with both, in the background."""

from __future__ import annotations

import asyncio
import contextlib
import shutil
from collections.abc import Callable, Coroutine, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import structlog

from app.contract.comparing import COMPARISON_TAG, ComparisonProgress, ComparisonStatus
from app.runtime.jobs import Progress
from app.runtime.worker import JobFailed
from app.server.calibrations.library import keep_own_calibration
from app.server.errors import Conflict, FieldError, NotAvailable
from app.server.parameters.in_force import ParametersInForce
from app.server.parameters.manager import ParameterManager
from app.server.rig.store import RigStore
from app.server.runs.compared_source import ComparedSource, ComparedSources
from app.server.runs.files import RunFiles
from app.server.runs.result_rows import result_rows
from app.server.runs.saved_clips import SavedClips
from app.server.runs.truths import TruthFiles
from app.server.shared import Shared
from app.server.source.manager import SourceManager
from app.storage import RunRecord, RunState, StorageError, StorageFull
from app.storage.runs import new_run_id
from app.versions import versions
from app.workers.methods.messages import FRAMES, SPEEDS, Compared, CompareMethods, NewRun
from app.workers.methods.process import compare_in_worker
from observer.errors import DynamicObserverError

log = structlog.get_logger(__name__)

_PICTURE = "picture.jpg"
# Free space required: half a minute of camera images, with a margin.
_SPARE_BYTES = 500 << 20

_T = TypeVar("_T")


class MethodComparison:
    """Runs one comparison at a time, which results in two ordinary runs.

    Neither the open source nor the current parameters change, and a live run continues.

    Args:
        held: returns whether it must be suspended because a robot is armed.
    """

    def __init__(
        self,
        shared: Shared,
        source: SourceManager,
        parameters: ParameterManager,
        rig: RigStore,
        files: RunFiles,
        truths: TruthFiles,
        clips: SavedClips,
        held: Callable[[], bool],
    ) -> None:
        self._shared = shared
        self._storage = shared.storage
        self._parameters = parameters
        self._rig = rig
        self._files = files
        self._truths = truths
        self._sources = ComparedSources(shared, source, clips)
        self._held = held
        self._task: asyncio.Task[None] | None = None
        self._title = ""
        self._picture: Path | None = None
        self._progress: Progress | None = None
        self._runs: tuple[str, ...] | None = None
        self._trouble: str | None = None

    def facts(self) -> ComparisonStatus:
        """Return the progress of the present comparison and the result of the newest one."""
        progress = self._progress
        going = None
        if progress is not None:
            words, share = progress.words, round(progress.share, 3)
            going = ComparisonProgress(self._title, words, share, self._held())
        return ComparisonStatus(going, self._runs, self._trouble)

    async def start(
        self, source: str | None, seconds: float, presets: Sequence[str]
    ) -> ComparisonStatus:
        """Begin to observe the same frames once with each preset.

        Args:
            source: None for the open one. Of live cameras the last seconds are used, otherwise the
                first.
            seconds: seconds of the source to compare.

        Raises:
            Conflict: another comparison is in progress, a robot is armed, or the last seconds of
                the open source are not kept. FieldError: a value is refused.
            NotAvailable: the last seconds cannot be saved now. StorageFull: there is no room.
        """
        if self._progress is not None:
            raise Conflict("a comparison is already in progress; wait for it, or cancel it")
        if self._held():
            raise Conflict(
                "a robot is armed, and a comparison would take processor time away from driving; "
                "disarm it first"
            )
        parameters = [self._parameters.compose(name, {}, {}) for name in presets]
        # Set before the first await, so that a second request is refused.
        self._progress = Progress("starting", 0.0)
        self._title = self._sources.title(source)
        accepted: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        work = self._run(source, seconds, list(zip(presets, parameters, strict=True)), accepted)
        task = self._task = asyncio.create_task(work, name="compare methods")
        # Not at the end of the task's own code: if cancelled at once, it runs none.
        task.add_done_callback(self._ended)
        self._shared.background.start(task)
        try:
            await asyncio.wait({task, accepted}, return_when=asyncio.FIRST_COMPLETED)
        except asyncio.CancelledError:
            task.cancel()
            raise
        if accepted.done():
            accepted.result()
        return self.facts()

    async def picture(self) -> bytes | None:
        """Return a JPEG of the newest frame with each method's result, side by side.

        Return None while nothing is being compared, or there is no frame yet.
        """
        path = self._picture
        if path is not None:
            with contextlib.suppress(OSError):
                return await asyncio.to_thread(path.read_bytes)
        return None

    async def cancel(self) -> None:
        """Cancel the comparison in progress, if any, and discard its results."""
        task = self._task
        if task is not None:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
            self._runs = self._trouble = None

    async def _run(
        self,
        source: str | None,
        seconds: float,
        methods: Sequence[tuple[str, ParametersInForce]],
        accepted: asyncio.Future[None],
    ) -> None:
        """Compare the methods.

        Args:
            accepted: ends once it is certain that the comparison can begin, or with the refusal.
        """
        try:
            async with self._sources.chosen(source) as compared:
                if await asyncio.to_thread(self._storage.folder.free_bytes) < _SPARE_BYTES:
                    raise StorageFull("no space is left to compare methods; free some disk space")
                self._title, self._runs, self._trouble = compared.title, None, None
                accepted.set_result(None)
                await self._compare(compared, seconds, methods)
        except Exception as error:
            if accepted.done():
                raise
            accepted.set_exception(error)

    def _ended(self, task: asyncio.Task[None]) -> None:
        del task
        self._progress = self._task = self._picture = None

    async def _compare(
        self,
        compared: ComparedSource,
        seconds: float,
        methods: Sequence[tuple[str, ParametersInForce]],
    ) -> None:
        try:
            async with self._files.quick.folder() as folder:
                self._picture = folder / _PICTURE
                job = self._job(compared, seconds, methods, folder)
                for run in job.runs:
                    await asyncio.to_thread(Path(run.folder).mkdir)
                done = await compare_in_worker(job, self._heard, self._held)
                self._heard(Progress("saving both runs", 1.0))
                keep = partial(self._keep, compared, job, done)
                records = await _whole(asyncio.to_thread(keep))
            for record in records:
                await self._truths.run_ended(record, None)
            self._runs = tuple(record.id for record in records)
        except (JobFailed, StorageError, NotAvailable, FieldError) as error:
            log.warning("comparison_failed", source=compared.shown, reason=str(error))
            self._trouble = str(error)

    def _job(
        self,
        compared: ComparedSource,
        seconds: float,
        methods: Sequence[tuple[str, ParametersInForce]],
        folder: Path,
    ) -> CompareMethods:
        runs = []
        for number, (preset, parameters) in enumerate(methods):
            id = new_run_id()
            run = NewRun(
                folder=str(folder / id),
                id=id,
                name=f"{compared.title}, {preset}",
                preset=preset,
                parameters=parameters.values.flat(),
                # The other runs count as re-runs of the first and use its images.
                images="jpeg" if number == 0 else "none",
            )
            runs.append(run)
        return CompareMethods(
            source=compared.spec,
            seconds=seconds,
            newest=compared.clip is not None,
            calibration_yaml=None if compared.calibration is None else compared.calibration.text,
            rig_yaml=self._rig.observed_text,
            versions=versions(),
            picture=str(folder / _PICTURE),
            runs=tuple(runs),
        )

    def _heard(self, progress: Progress) -> None:
        self._progress = progress

    def _keep(
        self, compared: ComparedSource, job: CompareMethods, done: Compared
    ) -> list[RunRecord]:
        """Store the worker's results as runs, all or none; call it in a thread."""
        records: list[RunRecord] = []
        calibration = compared.calibration
        try:
            for run, segments in zip(job.runs, done.segments, strict=True):
                before = records[0].id if records else compared.original
                record = self._storage.create_run(
                    id=run.id,
                    name=run.name,
                    source=compared.shown,
                    parameters=dict(run.parameters),
                    versions=dict(job.versions),
                    calibration_id=None if calibration is None else calibration.id,
                    preset=run.preset,
                    rig=job.rig_yaml,
                    record=run.images,
                    rerun_of=before,
                    tags=(COMPARISON_TAG,),
                )
                records.append(record)
                self._keep_files(record, Path(run.folder))
                if calibration is None:
                    keep_own_calibration(self._storage, done.calibration_yaml, record)
                records[-1] = self._storage.update_run(
                    run.id,
                    state=RunState.FINISHED,
                    frames=done.frames,
                    segments=segments,
                    begin_s=done.begin_s,
                    duration_s=done.duration_s,
                    recording_bytes=self._storage.folder.recording_bytes(run.id),
                )
        except BaseException:
            for record in records:
                with contextlib.suppress(DynamicObserverError):
                    self._storage.delete_run(record.id)
            raise
        return records

    def _keep_files(self, record: RunRecord, made: Path) -> None:
        speeds, frames = made / SPEEDS, made / FRAMES
        batches, content = list(result_rows(record.id, speeds)), frames.read_bytes()
        for file in (speeds, frames):
            file.unlink()
        folder = self._storage.folder.run(record.id)
        try:
            folder.parent.mkdir(parents=True, exist_ok=True)
            shutil.move(made, folder)
        except OSError as error:
            raise StorageError(f"{folder} cannot be written: {error.strerror}") from error
        for rows in batches:
            self._storage.append_speeds(rows)
        self._files.keep_frames(record, content)


async def _whole(work: Coroutine[Any, Any, _T]) -> _T:
    """Finish the work even if this task is cancelled meanwhile."""
    working = asyncio.ensure_future(work)
    try:
        return await asyncio.shield(working)
    except asyncio.CancelledError:
        await asyncio.gather(working, return_exceptions=True)
        raise
