"""Distribution of a benchmark's sources over processes, for accuracy only."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.sharedctypes import Synchronized
from typing import Any

import cv2

from observer.errors import DynamicObserverError
from observer.evaluation.source_run import SourceRun, run_source
from observer.evaluation.sources import BenchmarkSource
from observer.parameters import Parameters

_POLL_S = 0.2


class WorkerLost(DynamicObserverError):
    """A process died during its work."""


@contextmanager
def worker_pool(
    jobs: int, begin: Callable[..., None], *given: Any
) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool of new processes; pending work is cancelled at the end of the block.

    Args:
        jobs: number of processes. begin: called in each with ``given`` before its first work.

    Raises:
        WorkerLost: a process was killed, e.g. by the system for lack of memory.
    """
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(jobs, mp_context=context, initializer=begin, initargs=given)
    try:
        yield pool
    except BrokenProcessPool:
        raise WorkerLost(
            "a benchmark process was killed by the operating system; run with fewer jobs"
        ) from None
    finally:
        pool.shutdown(cancel_futures=True)


def use_one_core() -> None:
    """Limit this process to one core, as OpenCV's threads would compete with other processes."""
    cv2.setNumThreads(1)


def run_sources_in_processes(
    sources: Sequence[BenchmarkSource],
    presets: Mapping[str, Parameters],
    max_frames: int,
    gate_m: float,
    jobs: int,
    report: Callable[[int], None],
) -> list[dict[str, SourceRun]]:
    """Return ``run_source`` of each source, in the order of the sources, without times.

    Args:
        jobs: number of processes.
        report: called with the number of frames done over all sources, a few times a second.

    Raises:
        InputError: as for ``run_source``.
        WorkerLost: a process was killed, e.g. by the system for lack of memory.
    """
    done: Synchronized[int] = multiprocessing.get_context("spawn").Value("L", 0)
    with worker_pool(min(jobs, len(sources)), _begin, done) as pool:
        futures: list[Future[dict[str, SourceRun]]] = [
            pool.submit(_work, source, presets, max_frames, gate_m) for source in sources
        ]
        waiting = set(futures)
        while waiting:
            finished, waiting = wait(waiting, timeout=_POLL_S, return_when=FIRST_COMPLETED)
            for each in finished:
                each.result()
            report(done.value)
        return [each.result() for each in futures]


# In a worker: the shared counter of frames, for the process that started it.
_done: list[Synchronized[int]] = []


def _begin(done: Synchronized[int]) -> None:
    use_one_core()
    _done.append(done)


def _work(
    source: BenchmarkSource, presets: Mapping[str, Parameters], max_frames: int, gate_m: float
) -> dict[str, SourceRun]:
    planned, counted = source.planned(max_frames), 0

    def report(number: int) -> None:
        nonlocal counted
        _count(min(number, planned) - counted)
        counted = min(number, planned)

    runs = run_source(source, presets, max_frames, gate_m, report)
    _count(planned - counted)
    return {
        name: SourceRun(run.image_size, run.frames, run.skipped, run.tally, times_ms={})
        for name, run in runs.items()
    }


def _count(frames: int) -> None:
    (done,) = _done
    with done.get_lock():
        done.value += frames
