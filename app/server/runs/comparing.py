"""Comparison of two methods: a worker observes the same frames with both, in the background."""

from __future__ import annotations

import asyncio
import contextlib
import shutil
from collections.abc import AsyncIterator, Callable, Coroutine, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import structlog

from app.contract.comparing import COMPARISON_TAG, ComparisonProgress, ComparisonStatus
from app.contract.runs import ClipFile
from app.runtime.jobs import Progress
from app.runtime.worker import JobFailed
from app.server.calibrations.library import keep_own_calibration
from app.server.errors import Conflict, FieldError, NotAvailable
from app.server.parameters.in_force import ParametersInForce
from app.server.parameters.manager import ParameterManager
from app.server.rig.store import RigStore
from app.server.runs.files import RunFiles
from app.server.runs.result_rows import result_rows
from app.server.runs.saved_clips import SavedClips
from app.server.runs.truths import TruthFiles
from app.server.shared import Shared
from app.server.source.chosen_source import ChosenSource, choose_source
from app.server.source.manager import SourceManager
from app.storage import CalibrationRecord, RunRecord, RunState, StorageError, StorageFull
from app.storage.runs import new_run_id
from app.versions import versions
from app.workers.methods.messages import FRAMES, SPEEDS, Compared, CompareMethods, NewRun
from app.workers.methods.process import compare_in_worker
from observer.errors import DynamicObserverError
from observer.opening import exclusive_world, live_devices, shown_spec
from observer.recording.run_folder import RECORDING, RUNS

log = structlog.get_logger(__name__)

_SIMULATED = "simulated:"
_PICTURE = "picture.jpg"
# Free space required: half a minute of camera images, with a margin.
_SPARE_BYTES = 500 << 20
_LONGEST_TITLE = 80

_T = TypeVar("_T")


@dataclass(frozen=True)
class _Order:
    """Source of a comparison.

    Attributes:
        title: display name. spec: spec that opens it. shown: the spec without passwords.
        calibration: used instead of its own, or None.
        clip: temporary recording saved for the comparison, or None.
        original: id of the run whose recording it is, or None.
    """

    title: str
    spec: str
    shown: str
    calibration: CalibrationRecord | None
    clip: Path | None
    original: str | None


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
        self._source = source
        self._parameters = parameters
        self._rig = rig
        self._files = files
        self._truths = truths
        self._clips = clips
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
        self._title = _title(self._source.wanted if source is None else ChosenSource(source, None))
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
            async with self._ordered(source) as order:
                if await asyncio.to_thread(self._storage.folder.free_bytes) < _SPARE_BYTES:
                    raise StorageFull("no space is left to compare methods; free some disk space")
                self._title, self._runs, self._trouble = order.title, None, None
                accepted.set_result(None)
                await self._compare(order, seconds, methods)
        except Exception as error:
            if accepted.done():
                raise
            accepted.set_exception(error)

    def _ended(self, task: asyncio.Task[None]) -> None:
        del task
        self._progress = self._task = self._picture = None

    @asynccontextmanager
    async def _ordered(self, source: str | None) -> AsyncIterator[_Order]:
        """Yield what is to be compared; a clip saved for it is deleted after the block."""
        order = await self._order(source)
        try:
            yield order
        finally:
            if order.clip is not None:
                _delete(order.clip)

    async def _order(self, source: str | None) -> _Order:
        if source is None:
            chosen, state = self._source.wanted, self._source.state
            if state.source is not None and state.source.live:
                return await self._of_clip(chosen)
            if exclusive_world(chosen.source) is not None:
                raise FieldError(
                    ("body", "source"),
                    "a CoppeliaSim scene cannot be played twice; record a run of it and compare "
                    "with its recording",
                )
        else:
            if live_devices(source) or exclusive_world(source) is not None:
                raise FieldError(
                    ("body", "source"),
                    "open live cameras as the source first; their last seconds are then compared",
                )
            chosen = await asyncio.to_thread(choose_source, self._storage, source, None)
        shown = shown_spec(chosen.source)
        return _Order(
            title=_title(chosen),
            spec=chosen.source,
            shown=shown,
            calibration=chosen.calibration,
            clip=None,
            original=_run_of(Path(chosen.source)),
        )

    async def _of_clip(self, chosen: ChosenSource) -> _Order:
        saving = asyncio.ensure_future(self._clips.save())
        try:
            clip = self._path(await asyncio.shield(saving))
        except asyncio.CancelledError:
            # The engine saves it all the same.
            self._shared.background.start(self._delete_saved(saving))
            raise
        return _Order(
            title=_title(chosen),
            spec=str(clip),
            shown=shown_spec(chosen.source),
            # The calibration in use; if that is the source's own, the clip holds it.
            calibration=chosen.calibration,
            clip=clip,
            original=None,
        )

    def _path(self, clip: ClipFile) -> Path:
        return self._storage.folder.path.absolute() / clip.file

    async def _delete_saved(self, saving: asyncio.Future[ClipFile]) -> None:
        """Delete a clip as soon as it has been saved."""
        with contextlib.suppress(DynamicObserverError):
            _delete(self._path(await saving))

    async def _compare(
        self, order: _Order, seconds: float, methods: Sequence[tuple[str, ParametersInForce]]
    ) -> None:
        try:
            async with self._files.quick.folder() as folder:
                self._picture = folder / _PICTURE
                job = self._job(order, seconds, methods, folder)
                for run in job.runs:
                    await asyncio.to_thread(Path(run.folder).mkdir)
                done = await compare_in_worker(job, self._heard, self._held)
                self._heard(Progress("saving both runs", 1.0))
                keep = partial(self._keep, order, job, done)
                records = await _whole(asyncio.to_thread(keep))
            for record in records:
                await self._truths.run_ended(record, None)
            self._runs = tuple(record.id for record in records)
        except (JobFailed, StorageError, NotAvailable, FieldError) as error:
            log.warning("comparison_failed", source=order.shown, reason=str(error))
            self._trouble = str(error)

    def _job(
        self,
        order: _Order,
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
                name=f"{order.title}, {preset}",
                preset=preset,
                parameters=parameters.values.flat(),
                # The other runs count as re-runs of the first and use its images.
                images="jpeg" if number == 0 else "none",
            )
            runs.append(run)
        return CompareMethods(
            source=order.spec,
            seconds=seconds,
            newest=order.clip is not None,
            calibration_yaml=None if order.calibration is None else order.calibration.text,
            rig_yaml=self._rig.observed_text,
            versions=versions(),
            picture=str(folder / _PICTURE),
            runs=tuple(runs),
        )

    def _heard(self, progress: Progress) -> None:
        self._progress = progress

    def _keep(self, order: _Order, job: CompareMethods, done: Compared) -> list[RunRecord]:
        """Store the worker's results as runs, all or none; call it in a thread."""
        records: list[RunRecord] = []
        try:
            for run, segments in zip(job.runs, done.segments, strict=True):
                before = records[0].id if records else order.original
                record = self._storage.create_run(
                    id=run.id,
                    name=run.name,
                    source=order.shown,
                    parameters=dict(run.parameters),
                    versions=dict(job.versions),
                    calibration_id=None if order.calibration is None else order.calibration.id,
                    preset=run.preset,
                    rig=job.rig_yaml,
                    record=run.images,
                    rerun_of=before,
                    tags=(COMPARISON_TAG,),
                )
                records.append(record)
                self._keep_files(record, Path(run.folder))
                if order.calibration is None:
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


def _delete(clip: Path) -> None:
    with contextlib.suppress(OSError):
        clip.unlink(missing_ok=True)


def _title(chosen: ChosenSource) -> str:
    shown = chosen.name or shown_spec(chosen.source).removeprefix(_SIMULATED)
    return shown if len(shown) <= _LONGEST_TITLE else f"…{shown[1 - _LONGEST_TITLE :]}"


def _run_of(path: Path) -> str | None:
    """Return the id of the run whose recording this path is, or None."""
    is_one = path.name == RECORDING and path.parent.parent.name == RUNS
    return path.parent.name if is_one else None
