"""Accuracy and cost of presets over sources with ground truth: scenarios and seeds, or a folder."""

from __future__ import annotations

import statistics
import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from observer.errors import InputError
from observer.evaluation.breakdown import break_down
from observer.evaluation.choices import DEFAULT_MAX_FRAMES, LAB, Scale
from observer.evaluation.counts import Tally
from observer.evaluation.evaluate import summarise
from observer.evaluation.jobs import run_sources_in_processes
from observer.evaluation.results import (
    Benchmark,
    OpenCvCost,
    PresetResult,
    SourceResult,
    Timing,
)
from observer.evaluation.source_run import SourceRun, run_source
from observer.evaluation.sources import BenchmarkSource, described
from observer.evaluation.targets import Cost, targets
from observer.parameters import Parameters


def run_benchmark(
    sources: Sequence[str],
    presets: Mapping[str, Parameters],
    *,
    max_frames: int = DEFAULT_MAX_FRAMES,
    scale: Scale = LAB,
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
    clock: Callable[[], float] = time.perf_counter,
) -> Benchmark:
    """Run every preset over every source, at full speed.

    Each frame is read once and observed with all presets in turn, so that they see the same noise
    and share the machine's load. On some of the frames OpenCV's calls are timed instead of the
    stages.

    Args:
        sources: specs as for ``open_source``.
        presets: by the name to print, e.g. ``{"paper": preset("paper")}``.
        max_frames: most frames of each source.
        scale: a room or a road.
        jobs: processes to spread the sources over. Accuracy is the same whatever their number;
            cost is measured with one only.
        progress: called with the number of frames done and their total, after each frame of a
            source, or a few times a second with several jobs.

    Raises:
        InputError: nothing to do, or a source cannot be opened or has no calibration.
        WorkerLost: a process was killed by the system.
    """
    if not sources or not presets:
        raise InputError("a benchmark needs at least one source and one preset")
    plan = [described(spec) for spec in sources]
    total = sum(source.planned(max_frames) for source in plan)

    def report(done: int) -> None:
        if progress is not None:
            progress(done, total)

    if jobs > 1:
        runs = run_sources_in_processes(plan, presets, max_frames, scale.gate_m, jobs, report)
    else:
        runs = []
        before = 0
        for source in plan:
            planned = source.planned(max_frames)

            def note(number: int, before: int = before, planned: int = planned) -> None:
                report(before + min(number, planned))

            runs.append(run_source(source, presets, max_frames, scale.gate_m, note, clock))
            before += planned
            report(before)
    return Benchmark(
        scale=scale,
        jobs=jobs,
        presets=tuple(
            _preset_result(name, plan, [each[name] for each in runs], scale) for name in presets
        ),
        sources=tuple(
            _source_result(name, source, each[name])
            for name in presets
            for source, each in zip(plan, runs, strict=True)
        ),
    )


def _source_result(name: str, source: BenchmarkSource, run: SourceRun) -> SourceResult:
    return SourceResult(
        preset=name,
        source=source,
        frames=run.frames,
        skipped=run.skipped,
        evaluation=None if run.tally is None else summarise([run.tally]),
        false=() if run.tally is None else tuple(run.tally.false),
    )


def _preset_result(
    name: str, plan: Sequence[BenchmarkSource], runs: Sequence[SourceRun], scale: Scale
) -> PresetResult:
    timings = _timings(runs)
    opencv = _opencv(runs, timings)
    judged: list[tuple[Tally, str | None]] = [
        (run.tally, source.declares)
        for source, run in zip(plan, runs, strict=True)
        if run.tally is not None
    ]
    if not judged:
        return PresetResult(name, timings, opencv, None, None)
    tallies = [t for t, _ in judged]
    kinds: dict[str, list[Tally]] = defaultdict(list)
    for each, declares in judged:
        if declares is not None:
            kinds[f"{declares}, people" if each.people else declares].append(each)
    return PresetResult(
        preset=name,
        timings=timings,
        opencv=opencv,
        evaluation=summarise(tallies),
        breakdown=break_down(tallies, scale, _ordered(kinds)),
        targets=targets(judged, _cost(runs, timings, opencv)) if scale is LAB else (),
    )


def _ordered(kinds: Mapping[str, list[Tally]]) -> dict[str, list[Tally]]:
    """Return the kinds of scenarios, those with people last, ideal before faulty."""
    names = sorted(kinds, key=lambda kind: ("people" in kind, "faulty" in kind))
    return {name: kinds[name] for name in names}


def _timings(runs: Sequence[SourceRun]) -> dict[str, Timing]:
    values: dict[str, list[float]] = defaultdict(list)
    for run in runs:
        for stage, each in run.times_ms.items():
            values[stage] += each
    return {stage: _timing(each) for stage, each in values.items()}


def _opencv(runs: Sequence[SourceRun], timings: Mapping[str, Timing]) -> OpenCvCost | None:
    frames = [calls for run in runs for calls in run.opencv_ms]
    if not frames or "total" not in timings:
        return None
    bare = [sum(calls.values()) for calls in frames]
    whole = [ms for run in runs for ms in run.recorded_ms]
    timing = _timing(bare)
    if timing.median_ms <= 0:
        return None
    sums: dict[str, float] = defaultdict(float)
    for calls in frames:
        for call, ms in calls.items():
            sums[call] += ms / len(frames)
    return OpenCvCost(
        timing=timing,
        ratio=timings["total"].median_ms / timing.median_ms,
        ratio_within=statistics.median(w / b for w, b in zip(whole, bare, strict=True) if b > 0),
        calls_ms=dict(sorted(sums.items(), key=lambda item: -item[1])),
    )


def _cost(
    runs: Sequence[SourceRun], timings: Mapping[str, Timing], opencv: OpenCvCost | None
) -> Cost | None:
    if "total" not in timings:
        return None
    sizes = {run.image_size for run in runs}
    return Cost(
        image_size=sizes.pop() if len(sizes) == 1 else None,
        median_ms=timings["total"].median_ms,
        opencv_ratio=None if opencv is None else opencv.ratio,
    )


def _timing(values: Sequence[float]) -> Timing:
    return Timing(statistics.median(values), float(np.percentile(values, 95)))
