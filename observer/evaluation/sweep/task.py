"""Task of a worker (a combination over a source or through a crowd) and its outcome."""

from __future__ import annotations

import functools
import hashlib
import json
import statistics
import time
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import cv2

from observer.errors import DynamicObserverError
from observer.evaluation.evaluate import summarise
from observer.evaluation.source_run import SourceRun, run_opened
from observer.evaluation.sweep.crowds import SweepCrowd, driving_figures
from observer.evaluation.sweep.frames import FrameCache
from observer.evaluation.sweep.sources import SweepSource
from observer.navigation.parameters import AllParameters
from observer.parameters import Parameters, preset
from observer.version import library_version

# Cost is relative to this preset, which observes this many frames from the middle of the source in
# turn with the combination, so that both share the machine's load.
REFERENCE = "default"
_REFERENCE_FRAMES = 40
_COMBINATION = "combination"


@dataclass(frozen=True)
class Task:
    """A combination over a source.

    Attributes:
        parameters: including those of guard and planner if the source is a crowd.
        gate_m: highest distance of an instance from its body.
        version: of the method, as from ``method_version``.
        elsewhere: whether another machine, with another version, may work on it.
    """

    source: SweepSource | SweepCrowd
    parameters: Parameters
    gate_m: float
    version: str
    elsewhere: bool = False

    @functools.cached_property
    def key(self) -> str:
        """Name of the result, derived from everything that it depends on."""
        named = {
            "source": self.source.digest,
            "extent": self.source.extent,
            "parameters": self.parameters.flat(),
            "gate_m": self.gate_m,
            "version": self.version,
        }
        text = json.dumps(named, sort_keys=True, allow_nan=False)
        return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


@dataclass(frozen=True)
class Outcome:
    """Outcome of a task.

    Attributes:
        error: one sentence if it failed; the rest is then unknown.
        frames: observed. skipped: frames that the source could not read.
        figures: as from ``Evaluation.as_dict``, for a crowd as from ``driving_figures``.
        median_ms: of the whole of ``observe``, on a shared machine.
        cost_ratio: median over the frames of this cost relative to that of the preset ``default``
            on the same frame; None if there were too few frames.
        cpu_s, wall_s: CPU time of the process and wall-clock time that the task took, seconds;
            with several threads in a process ``cpu_s`` is their sum.
    """

    error: str | None = None
    frames: int = 0
    skipped: int = 0
    figures: Mapping[str, float | int | None] | None = None
    median_ms: float | None = None
    cost_ratio: float | None = None
    cpu_s: float = 0.0
    wall_s: float = 0.0


def run_task(task: Task, cache_bytes: int, own_process: bool) -> Outcome:
    """Evaluate a combination over a source, in a worker.

    Errors are reported in the outcome, so that they end neither the worker nor the sweep.

    Args:
        cache_bytes: of frames that this worker caches.
        own_process: whether the process works only for sweeps. OpenCV then uses one thread, so that
            the workers do not compete.
    """
    if own_process:
        cv2.setNumThreads(1)
    cpu, wall = time.process_time(), time.perf_counter()
    try:
        if task.elsewhere and task.version != method_version():
            return Outcome(
                error=f"the worker has version {method_version()} of the method, but the sweep "
                f"needs {task.version}; install the same version on every machine of the "
                "cluster"
            )
        outcome = _outcome(task, cache_bytes)
    except DynamicObserverError as error:
        return Outcome(error=str(error))
    except Exception as error:  # noqa: BLE001 -- one combination must not end hours of work
        return Outcome(error=f"{type(error).__name__}: {error}")
    if outcome.error is not None:
        return outcome
    return replace(outcome, cpu_s=time.process_time() - cpu, wall_s=time.perf_counter() - wall)


@functools.cache
def method_version() -> str:
    """Return the installed version with a digest of the code, as a clone may differ from it."""
    digest = hashlib.blake2b(digest_size=4)
    folder = Path(__file__).parents[2]
    for path in sorted(folder.rglob("*.py")):
        digest.update(str(path.relative_to(folder)).encode() + b"\0" + path.read_bytes())
    return f"{library_version()}+{digest.hexdigest()}"


@functools.cache
def _cache(most_bytes: int) -> FrameCache:
    return FrameCache(most_bytes)


def _outcome(task: Task, cache_bytes: int) -> Outcome:
    if isinstance(task.source, SweepCrowd):
        assert isinstance(task.parameters, AllParameters)
        return Outcome(figures=driving_figures(task.source, task.parameters))
    runs = _observe(task.source, task.parameters, task.gate_m, _cache(cache_bytes))
    run = runs[_COMBINATION]
    if run.tally is None or run.frames == 0:
        return Outcome(error=f"{task.source.name} has no frame that can be evaluated")
    return Outcome(
        frames=run.frames,
        skipped=run.skipped,
        figures=summarise([run.tally]).as_dict(),
        median_ms=statistics.median(run.times_ms["total"]) if run.timed_frames else None,
        cost_ratio=_cost_ratio(run, runs[REFERENCE]),
    )


def _observe(
    source: SweepSource, parameters: Parameters, gate_m: float, cache: FrameCache
) -> dict[str, SourceRun]:
    begin = max(0, (source.frames - _REFERENCE_FRAMES) // 2)
    opened = cache.opened(source)
    with closing(opened.source):
        return run_opened(
            opened,
            source.benchmark,
            {_COMBINATION: parameters, REFERENCE: preset(REFERENCE)},
            source.frames,
            gate_m,
            lambda _: None,
            during={REFERENCE: range(begin, begin + _REFERENCE_FRAMES)},
            recorded_share=0.0,
        )


def _cost_ratio(run: SourceRun, reference: SourceRun) -> float | None:
    mine = dict(zip(run.timed_frames, run.times_ms.get("total", []), strict=True))
    others = zip(reference.timed_frames, reference.times_ms.get("total", []), strict=True)
    ratios = [mine[frame] / ms for frame, ms in others if frame in mine and ms > 0]
    return statistics.median(ratios) if ratios else None
