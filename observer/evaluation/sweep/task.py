"""One combination over one source: what a worker does, and what it answers."""

from __future__ import annotations

import functools
import hashlib
import json
import statistics
import time
from collections.abc import Mapping
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2

from observer.errors import DynamicObserverError
from observer.evaluation.evaluate import summarise
from observer.evaluation.source_run import SourceRun, run_opened
from observer.evaluation.sweep.frames import FrameCache
from observer.evaluation.sweep.sources import SweepSource
from observer.parameters import Parameters, preset
from observer.version import library_version

# Cost is told relative to this preset, which sees so many frames from the middle of the source in
# turn with the combination: both share the machine's moods, whoever else works on it.
REFERENCE = "default"
_REFERENCE_FRAMES = 40
_COMBINATION = "combination"


@dataclass(frozen=True)
class Task:
    """One combination over one source.

    Attributes:
        gate_m: how far an instance may lie from what it is.
        version: of the method, as ``method_version`` tells it.
        elsewhere: whether another machine may work on it, whose version may be another one.
    """

    source: SweepSource
    parameters: Parameters
    gate_m: float
    version: str
    elsewhere: bool = False

    @functools.cached_property
    def key(self) -> str:
        """Names the result by all that it depends on."""
        named = {
            "source": self.source.digest,
            "frames": self.source.frames,
            "parameters": self.parameters.flat(),
            "gate_m": self.gate_m,
            "version": self.version,
        }
        text = json.dumps(named, sort_keys=True, allow_nan=False)
        return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


@dataclass(frozen=True)
class Outcome:
    """What came of a task.

    Attributes:
        error: one sentence where it failed; nothing else is known then.
        frames: observed. skipped: frames that the source could not read.
        figures: as ``Evaluation.as_dict`` gives them.
        median_ms: of the whole of ``observe``, on a machine that others use too.
        cost_ratio: median over the frames of this cost over that of the preset ``default`` on
            the same frame; None where there were too few frames.
        cpu_s, wall_s: what the task took, of its process and by the clock, seconds; with several
            threads in a process ``cpu_s`` is theirs together.
    """

    error: str | None = None
    frames: int = 0
    skipped: int = 0
    figures: Mapping[str, float | int | None] | None = None
    median_ms: float | None = None
    cost_ratio: float | None = None
    cpu_s: float = 0.0
    wall_s: float = 0.0

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return asdict(self)


def run_task(task: Task, cache_bytes: int, own_process: bool) -> Outcome:
    """Evaluate one combination over one source, in a worker.

    Whatever breaks is told in the outcome, so that it ends neither the worker nor the sweep.

    Args:
        cache_bytes: of frames that this worker keeps, taken from its first task.
        own_process: whether the process works for sweeps alone. OpenCV then has one thread, or
            the workers would stand in each other's way.
    """
    if own_process:
        cv2.setNumThreads(1)
    cpu, wall = time.process_time(), time.perf_counter()
    try:
        if task.elsewhere and task.version != method_version():
            return Outcome(
                error=f"the worker has version {method_version()} of the method, the sweep "
                f"{task.version}; install the same one on every machine of the cluster"
            )
        runs = _observe(task, _cache(cache_bytes))
    except DynamicObserverError as error:
        return Outcome(error=str(error))
    except Exception as error:  # noqa: BLE001 -- one combination must not end hours of work
        return Outcome(error=f"{type(error).__name__}: {error}")
    run = runs[_COMBINATION]
    if run.tally is None or run.frames == 0:
        return Outcome(error=f"{task.source.name} has no frame that can be judged")
    return Outcome(
        frames=run.frames,
        skipped=run.skipped,
        figures=summarise([run.tally]).as_dict(),
        median_ms=statistics.median(run.times_ms["total"]) if run.timed_frames else None,
        cost_ratio=_cost_ratio(run, runs[REFERENCE]),
        cpu_s=time.process_time() - cpu,
        wall_s=time.perf_counter() - wall,
    )


@functools.cache
def method_version() -> str:
    """The installed version, with a digest of the library's own text: a clone may be changed."""
    digest = hashlib.blake2b(digest_size=4)
    folder = Path(__file__).parents[2]
    for path in sorted(folder.rglob("*.py")):
        digest.update(str(path.relative_to(folder)).encode() + b"\0" + path.read_bytes())
    return f"{library_version()}+{digest.hexdigest()}"


@functools.cache
def _cache(most_bytes: int) -> FrameCache:
    return FrameCache(most_bytes)


def _observe(task: Task, cache: FrameCache) -> dict[str, SourceRun]:
    begin = max(0, (task.source.frames - _REFERENCE_FRAMES) // 2)
    opened = cache.opened(task.source)
    with closing(opened.source):
        return run_opened(
            opened,
            task.source.benchmark,
            {_COMBINATION: task.parameters, REFERENCE: preset(REFERENCE)},
            task.source.frames,
            task.gate_m,
            lambda _: None,
            during={REFERENCE: range(begin, begin + _REFERENCE_FRAMES)},
            recorded_share=0.0,
        )


def _cost_ratio(run: SourceRun, reference: SourceRun) -> float | None:
    mine = dict(zip(run.timed_frames, run.times_ms.get("total", []), strict=True))
    others = zip(reference.timed_frames, reference.times_ms.get("total", []), strict=True)
    ratios = [mine[frame] / ms for frame, ms in others if frame in mine and ms > 0]
    return statistics.median(ratios) if ratios else None
