"""Accuracy and cost of presets over sources with truth: scenarios and seeds, or a folder.

Time spent in the source (rendering, reading) is left out of every figure.
"""

from __future__ import annotations

import statistics
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from observer.errors import InputError
from observer.evaluation.evaluate import (
    FIGURE_TITLES,
    Evaluation,
    markdown_table,
    shown,
    summarise,
)
from observer.evaluation.lines import checked_lines
from observer.evaluation.tally import GATE_M, Tally, tally
from observer.jsonl import observation_line
from observer.observer import Observer
from observer.opening import open_source
from observer.parameters import Parameters
from observer.types import StereoFrame

# A scenario without an end is left after this many frames, unless told otherwise.
DEFAULT_MAX_FRAMES = 300
# Caches and clocks settle first.
_WARM_UP_FRAMES = 3


@dataclass(frozen=True)
class Progress:
    """How far a benchmark has come.

    Attributes:
        done, total: frames. what: the run at hand, for people.
    """

    done: int
    total: int
    what: str


@dataclass(frozen=True)
class Timing:
    """Milliseconds of one stage over all frames."""

    median_ms: float
    p95_ms: float


@dataclass(frozen=True)
class SourceResult:
    """One preset on one source.

    Attributes:
        evaluation: None where the source has no truth.
        skipped: frames that the source could not read.
    """

    preset: str
    source: str
    frames: int
    skipped: int
    evaluation: Evaluation | None


@dataclass(frozen=True)
class PresetResult:
    """One preset over all sources.

    Attributes:
        timings: by stage, ``total`` being the whole of ``observe``; without the first frames.
        evaluation: all sources with truth together, None without any.
    """

    preset: str
    timings: Mapping[str, Timing]
    evaluation: Evaluation | None


@dataclass(frozen=True)
class Benchmark:
    """What ``run_benchmark`` found."""

    presets: tuple[PresetResult, ...]
    sources: tuple[SourceResult, ...]

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "presets": [
                {
                    "preset": p.preset,
                    "timings_ms": {
                        stage: {"median": t.median_ms, "p95": t.p95_ms}
                        for stage, t in p.timings.items()
                    },
                    "evaluation": p.evaluation.as_dict() if p.evaluation else None,
                }
                for p in self.presets
            ],
            "sources": [
                {
                    "preset": s.preset,
                    "source": s.source,
                    "frames": s.frames,
                    "skipped": s.skipped,
                    "evaluation": s.evaluation.as_dict() if s.evaluation else None,
                }
                for s in self.sources
            ],
        }

    def markdown(self) -> str:
        """Three tables: accuracy, accuracy by source, and cost."""
        names = [p.preset for p in self.presets]
        parts = ["## Accuracy\n", markdown_table(["figure", *names], self._accuracy())]
        parts += [
            "\n## By source\n",
            markdown_table(_SOURCE_HEADER, map(_source_row, self.sources)),
        ]
        parts += ["\n## Cost of `observe`, ms, median / p95\n"]
        parts += [markdown_table(["stage", *names], self._cost())]
        return "\n".join(parts)

    def _accuracy(self) -> list[list[str]]:
        return [
            [
                title,
                *(shown(getattr(p.evaluation, name) if p.evaluation else None)
                  for p in self.presets),
            ]
            for name, title in FIGURE_TITLES.items()
        ]  # fmt: skip

    def _cost(self) -> list[list[str]]:
        stages = dict.fromkeys(stage for p in self.presets for stage in p.timings)
        return [
            [
                stage,
                *(
                    f"{p.timings[stage].median_ms:.1f} / {p.timings[stage].p95_ms:.1f}"
                    if stage in p.timings
                    else "-"
                    for p in self.presets
                ),
            ]
            for stage in stages
        ]


def simulated_sources(scenarios: Sequence[str], seeds: Sequence[int]) -> tuple[str, ...]:
    """The specs of every scenario with every seed."""
    return tuple(f"simulated:{name}?seed={seed}" for name in scenarios for seed in seeds)


def run_benchmark(
    sources: Sequence[str],
    presets: Mapping[str, Parameters],
    *,
    max_frames: int = DEFAULT_MAX_FRAMES,
    gate_m: float = GATE_M,
    progress: Callable[[Progress], None] | None = None,
    clock: Callable[[], float] = time.perf_counter,
) -> Benchmark:
    """Run every preset over every source, at full speed.

    Each frame is read once and observed by all presets in turn, so that they see the same noise
    and share the machine's moods.

    Args:
        sources: specs as ``open_source`` takes them.
        presets: by the name to print, as ``{"paper": preset("paper")}``.
        max_frames: most frames of each source.
        gate_m: as for ``evaluate``.
        progress: called after each frame of a source.

    Raises:
        InputError: nothing to do, or a source cannot be opened or has no calibration.
    """
    if not sources or not presets:
        raise InputError("a benchmark needs at least one source and one preset")
    times: dict[str, dict[str, list[float]]] = {name: defaultdict(list) for name in presets}
    tallies: dict[str, list[Tally]] = {name: [] for name in presets}
    results: list[SourceResult] = []
    for number, spec in enumerate(sources):

        def report(done: int, number: int = number, spec: str = spec) -> None:
            if progress is not None:
                total = len(sources) * max_frames
                progress(Progress(number * max_frames + done, total, spec))

        runs = _run_source(spec, presets, max_frames, gate_m, report, clock)
        for name, run in runs.items():
            for stage, values in run.times.items():
                times[name][stage] += values
            if run.tally is not None:
                tallies[name].append(run.tally)
            evaluation = None if run.tally is None else summarise([run.tally])
            results.append(SourceResult(name, spec, run.frames, run.skipped, evaluation))
        report(max_frames)
    return Benchmark(
        presets=tuple(
            PresetResult(
                preset=name,
                timings={stage: _timing(values) for stage, values in times[name].items()},
                evaluation=summarise(tallies[name]) if tallies[name] else None,
            )
            for name in presets
        ),
        sources=tuple(sorted(results, key=lambda r: list(presets).index(r.preset))),
    )


@dataclass(frozen=True)
class _Run:
    frames: int
    skipped: int
    times: Mapping[str, list[float]]
    tally: Tally | None


def _run_source(
    spec: str,
    presets: Mapping[str, Parameters],
    max_frames: int,
    gate_m: float,
    report: Callable[[int], None],
    clock: Callable[[], float],
) -> dict[str, _Run]:
    opened = open_source(spec)
    try:
        calibration = opened.source.calibration
        if calibration is None:
            raise InputError(f"{spec} brings no calibration, so it cannot be benchmarked")
        observers = {
            name: Observer(calibration, parameters, clock=clock)
            for name, parameters in presets.items()
        }
        lines: dict[str, list[dict[str, Any]]] = {name: [] for name in presets}
        times: dict[str, dict[str, list[float]]] = {name: defaultdict(list) for name in presets}
        read = skipped = 0
        for frame in _frames(opened.source.read, max_frames):
            read += 1
            report(read)
            if not isinstance(frame, StereoFrame):
                skipped += 1
                continue
            for name, observer in observers.items():
                observation = observer.observe(frame)
                lines[name].append(observation_line(observation))
                if read > _WARM_UP_FRAMES:
                    for stage, ms in observation.timings_ms.items():
                        times[name][stage].append(ms)
        return {
            name: _Run(
                frames=len(lines[name]),
                skipped=skipped,
                times=times[name],
                tally=None
                if opened.truth is None
                else tally(checked_lines(lines[name]), opened.truth, gate_m),
            )
            for name in presets
        }
    finally:
        opened.source.close()


def _frames(read: Callable[[], Any], most: int) -> Iterator[Any]:
    for _ in range(most):
        frame = read()
        if frame is None:
            return
        yield frame


def _timing(values: list[float]) -> Timing:
    return Timing(statistics.median(values), float(np.percentile(values, 95)))


_SOURCE_HEADER = [
    "source", "preset", "recall", "false / 100", "speed RMSE", "velocity RMSE", "centre RMSE",
    "coverage", "delay s", "MOTA",
]  # fmt: skip


def _source_row(result: SourceResult) -> list[str]:
    e = result.evaluation
    if e is None:
        return [result.source, result.preset, *["-"] * (len(_SOURCE_HEADER) - 2)]
    figures = [
        e.recall, e.false_per_100_frames, e.speed_rmse_mps, e.velocity_rmse_mps, e.centre_rmse_m,
        e.coverage, e.delay_median_s, e.mota,
    ]  # fmt: skip
    return [result.source, result.preset, *map(shown, figures)]
