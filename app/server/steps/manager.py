"""Steps of the method on one pair, computed in a separate process and cached."""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

from app.contract.parameters import ParameterValues
from app.contract.steps import MethodSteps, StepFormat
from app.contract.values import filled
from app.runtime.worker import LastingWorker
from app.server.errors import Conflict, FieldError, NotAvailable
from app.server.parameters.manager import ParameterManager
from app.server.source.chosen_source import RUN, ChosenSource, choose_source
from app.server.source.manager import SourceManager
from app.storage import Storage
from app.workers.steps.messages import DrawStep, Look, Steps, StepsAnswer
from app.workers.steps.process import steps_worker
from observer.errors import ParameterError
from observer.opening import exclusive_world, live_devices, shown_spec, source_kind
from observer.parameters import Parameters, without_effect
from observer.parameters.fields import PLANAR

_USUAL = "simulated:lab"
_PAPER = "paper"
# Size of the answer cache; a picture takes some hundred kilobytes.
_MOST_BYTES = 32 << 20
# Seconds after which an idle process is ended: it holds memory, and files of a source that may be
# deleted.
_IDLE_S = 60.0


@dataclass(frozen=True)
class PairChoice:
    """Requested pair.

    Attributes:
        source: None for the open one, or a substitute if that is live. frame: None for one worth
            looking at. preset: preset that the values come from. changes: dotted name -> value.
    """

    source: str | None
    frame: int | None
    preset: str
    changes: ParameterValues


@dataclass(frozen=True)
class _Found:
    """Resolved choice: the source's display spec, and what the worker needs to know."""

    source: str
    look: Look
    preset_values: ParameterValues
    values: ParameterValues


class MethodStepsManager:
    """Maker of the steps' facts and files; used in the event loop.

    Args:
        held: returns whether nothing may be computed now because a robot is armed.
        worker: makes the handle of the process, which starts when needed.
    """

    def __init__(
        self,
        storage: Storage,
        source: SourceManager,
        parameters: ParameterManager,
        held: Callable[[], bool],
        worker: Callable[[], LastingWorker] = steps_worker,
    ) -> None:
        self._storage = storage
        self._source = source
        self._parameters = parameters
        self._held = held
        self._make_worker = worker
        self._worker: LastingWorker | None = None
        # Submits one job at a time to the worker; jobs cancelled while they wait never start.
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="method steps")
        # Number of requests that wait for the worker; without any, a timer ends it.
        self._under_way = 0
        self._resting: asyncio.TimerHandle | None = None
        self._closed = False
        self._kept: OrderedDict[str, Steps | bytes] = OrderedDict()

    async def steps(self, choice: PairChoice) -> MethodSteps:
        """Return the results of each step.

        Raises:
            FieldError, ParameterError: the choice is refused. Conflict: a robot is armed.
            NotAvailable: it cannot be computed at the moment.
        """
        found = await self._find(choice)
        steps = cast(Steps, await self._answered(DrawStep(found.look)))
        return filled(
            MethodSteps,
            steps,
            source=found.source,
            preset=choice.preset,
            preset_values=found.preset_values,
            values=found.values,
            models=PLANAR,
        )

    async def file(
        self,
        choice: PairChoice,
        number: int,
        format_: StepFormat,
        *,
        dark: bool,
        labelled: bool,
    ) -> bytes:
        """Return the picture or the data of one step.

        Args:
            number: from 1 to 9. dark: for a page with a dark background. labelled: with title,
                formula and meaning.

        Raises:
            FieldError, ParameterError, Conflict, NotAvailable: as for ``steps``.
        """
        found = await self._find(choice)
        job = DrawStep(found.look, number, format_, dark, labelled)
        return cast(bytes, await self._answered(job))

    async def close(self) -> None:
        """End the process; safe to call twice."""
        self._closed = True
        self._stop_resting()
        worker, self._worker = self._worker, None
        if worker is not None:
            worker.end()
        await asyncio.to_thread(self._thread.shutdown, cancel_futures=True)
        if worker is not None:
            await asyncio.to_thread(worker.close)

    # --- the request -------------------------------------------------------------------------

    async def _find(self, choice: PairChoice) -> _Found:
        before = self._parameters.compose(choice.preset, {}, {}).values.flat()
        after = self._parameters.compose(choice.preset, {}, choice.changes).values.flat()
        _check_effect(choice, after)
        chosen = await self._chosen(choice.source)
        own = set(Parameters().flat())
        spec = chosen.source
        calibration = chosen.calibration
        look = Look(
            source=spec,
            state=await asyncio.to_thread(_state, spec),
            frame=choice.frame,
            parameters=Parameters().difference(Parameters().changed(_of(after, own))),
            calibration_yaml=None if calibration is None else calibration.text,
        )
        named = self._named(chosen)
        return _Found(named, look, _of(before, own), _of(after, own))

    async def _chosen(self, source: str | None) -> ChosenSource:
        """Return the source to look at; only sources already known to the server are allowed.

        Raises:
            FieldError: the source is live, or was never opened on this server.
        """
        wanted = self._source.wanted
        if source is None:
            source = await self._usual()
        if live_devices(source) or exclusive_world(source) is not None:
            raise FieldError(
                ("query", "source"),
                "a live source shows every frame only once; record a run of it and choose that "
                "run's recording",
            )
        if source in (wanted.source, self._named(wanted)):
            return wanted
        scenario = source_kind(source) == "simulated"
        known = scenario or source.startswith(RUN) or source in self._source.recent.specs
        if not known:
            raise FieldError(
                ("query", "source"),
                f"{shown_spec(source)[:80]!r} has not been opened on this server "
                f"yet; open it once as the source, or choose simulated:SCENARIO or run:ID",
            )
        return await asyncio.to_thread(choose_source, self._storage, source, None)

    async def _usual(self) -> str:
        """Return the open source; if it is live, the newest recording, or else the lab scenario."""
        wanted = self._source.wanted.source
        if not live_devices(wanted) and exclusive_world(wanted) is None:
            return wanted
        runs = await asyncio.to_thread(self._storage.list_runs, limit=50)
        for run in runs:
            images = run.record not in (None, "none")
            if images and run.state != "running" and run.frames > 1:
                return f"{RUN}{run.id}"
        return _USUAL

    def _named(self, chosen: ChosenSource) -> str:
        """Return the spec of a source that names a run's recording by the run, not by its path."""
        return chosen.source if chosen.name is None else f"{RUN}{Path(chosen.source).parent.name}"

    # --- the work ----------------------------------------------------------------------------

    async def _answered(self, job: DrawStep) -> Steps | bytes:
        key = _key(job)
        if key in self._kept:
            self._kept.move_to_end(key)
            return self._kept[key]
        if self._held():
            raise Conflict(
                "a robot is armed, and this would take processor time away from driving; disarm it "
                "first"
            )
        result = await self._done(job)
        self._keep(key, result)
        if isinstance(result, Steps) and job.look.frame is None:
            # The page's next requests will name the frame it was told.
            self._keep(_key(replace(job, look=replace(job.look, frame=result.frame))), result)
        return result

    async def _done(self, job: DrawStep) -> Steps | bytes:
        loop = asyncio.get_running_loop()
        with self._kept_awake() as worker:
            answer = await loop.run_in_executor(self._thread, worker.do, job, StepsAnswer)
        if answer is None:
            raise NotAvailable(
                "the steps could not be computed in time; try again, or choose a frame nearer to "
                "the source's beginning"
            )
        if answer.result is None:
            raise FieldError(("query", answer.place), answer.refused)
        return answer.result

    @contextmanager
    def _kept_awake(self) -> Iterator[LastingWorker]:
        """Yield the worker, which becomes idle when the last of overlapping requests has ended.

        Raises:
            NotAvailable: the server is shutting down.
        """
        if self._closed:
            raise NotAvailable("the server is shutting down")
        if self._worker is None:
            self._worker = self._make_worker()
        self._stop_resting()
        self._under_way += 1
        try:
            yield self._worker
        finally:
            self._under_way -= 1
            if self._under_way == 0 and not self._closed:
                loop = asyncio.get_running_loop()
                self._resting = loop.call_later(_IDLE_S, self._rest)

    def _stop_resting(self) -> None:
        if self._resting is not None:
            self._resting.cancel()
            self._resting = None

    def _rest(self) -> None:
        """End the process after it has been idle for a while; the next request starts another."""
        worker, self._worker = self._worker, None
        if worker is not None:
            self._thread.submit(worker.close)

    def _keep(self, key: str, result: Steps | bytes) -> None:
        self._kept[key] = result
        while sum(map(_size, self._kept.values())) > _MOST_BYTES:
            self._kept.popitem(last=False)


def _check_effect(choice: PairChoice, values: ParameterValues) -> None:
    """Refuse a method without these steps, and values without effect.

    Raises:
        FieldError: it is not a planar method. ParameterError: names each value without effect.
    """
    model = str(values["ego_motion.model"])
    if model not in PLANAR:
        by_preset = "ego_motion.model" not in choice.changes
        what = f"the preset {choice.preset} uses" if by_preset else "this is"
        raise FieldError(
            ("query", "preset" if by_preset else "ego_motion.model"),
            f"{what} the {model} method, but the nine steps are the paper's; choose the preset "
            f"{_PAPER}, or {' or '.join(PLANAR)} as the method",
        )
    own = Parameters().flat()
    idle = without_effect(choice.changes, model) | {
        name: "has no effect on what is observed" for name in choice.changes if name not in own
    }
    if idle:
        raise ParameterError(idle)


def _of(values: ParameterValues, names: set[str]) -> ParameterValues:
    return {name: value for name, value in values.items() if name in names}


def _state(spec: str) -> str:
    """Return a text that changes when the files of a source change."""
    if source_kind(spec) == "simulated":
        return ""
    try:
        found = Path(spec).stat()
    except OSError:
        return "gone"
    return f"{found.st_mtime_ns} {found.st_size}"


def _key(job: DrawStep) -> str:
    # This is unambiguous because parameters are always in the order of their declaration.
    return repr(job)


def _size(result: Steps | bytes) -> int:
    return len(result) if isinstance(result, bytes) else len(repr(result))
