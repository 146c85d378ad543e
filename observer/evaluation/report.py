"""Report on a benchmark's result as Markdown."""

from __future__ import annotations

from collections.abc import Sequence

from observer.evaluation.breakdown import breakdown_tables
from observer.evaluation.evaluate import FIGURE_TITLES, markdown_table, shown
from observer.evaluation.results import Benchmark, OpenCvCost, PresetResult, SourceResult, Timing
from observer.evaluation.targets import targets_table

# Number of OpenCV's calls that are shown, most expensive first.
_CALLS = 8


def benchmark_markdown(result: Benchmark) -> str:
    """Return tables of targets, of accuracy overall, by class and by source, and of cost."""
    presets = result.presets
    names = [p.preset for p in presets]
    parts = []
    if any(p.targets for p in presets):
        parts += ["## Targets\n", targets_table({p.preset: p.targets for p in presets})]
    parts += ["## Accuracy\n", markdown_table(["figure", *names], _accuracy(presets))]
    broken_down = {p.preset: p.breakdown for p in presets if p.breakdown is not None}
    if broken_down:
        parts += ["## Accuracy by range, speed, direction and scenarios\n"]
        parts += [breakdown_tables(broken_down)]
    parts += ["## By source\n", markdown_table(_SOURCE_HEADER, map(_source_row, result.sources))]
    parts += ["## Cost of `observe`, ms, median / p95\n"]
    if any(p.timings for p in presets):
        parts += [markdown_table(["stage", *names], _cost(presets))]
        parts += [
            f"### OpenCV's calls with `{p.preset}`, ms a frame, mean\n\n{_calls(p.opencv)}"
            for p in presets
            if p.opencv is not None
        ]
    else:
        parts += [f"Not measured: {result.jobs} processes shared the machine.\n"]
    return "\n".join(parts)


def _accuracy(presets: Sequence[PresetResult]) -> list[list[str]]:
    return [
        [title, *(shown(getattr(p.evaluation, name) if p.evaluation else None) for p in presets)]
        for name, title in FIGURE_TITLES.items()
    ]


def _cost(presets: Sequence[PresetResult]) -> list[list[str]]:
    stages = dict.fromkeys(stage for p in presets for stage in p.timings if stage != "total")
    rows = [[stage, *(_both(p.timings.get(stage)) for p in presets)] for stage in stages]
    rows += [["**whole step**", *(_both(p.timings.get("total")) for p in presets)]]
    rows += [
        ["OpenCV's calls alone", *(_both(p.opencv.timing if p.opencv else None) for p in presets)],
        ["whole step / OpenCV", *(shown(p.opencv.ratio if p.opencv else None) for p in presets)],
        [
            "the same within a frame, median",
            *(shown(p.opencv.ratio_within if p.opencv else None) for p in presets),
        ],
    ]
    return rows


def _both(timing: Timing | None) -> str:
    return "-" if timing is None else f"{timing.median_ms:.2f} / {timing.p95_ms:.2f}"


def _calls(cost: OpenCvCost) -> str:
    shown_calls = list(cost.calls_ms.items())[:_CALLS]
    return markdown_table(["call", "ms"], [[f"`{call}`", f"{ms:.2f}"] for call, ms in shown_calls])


_SOURCE_HEADER = [
    "source", "preset", "recall", "false / 100", "speed RMSE", "velocity RMSE", "centre RMSE",
    "coverage", "box IoU", "surplus / 100", "unflagged", "delay s", "switches", "MOTA",
    "degraded", "lost",
]  # fmt: skip


def _source_row(result: SourceResult) -> list[str]:
    e, spec = result.evaluation, result.source.spec
    if e is None:
        return [spec, result.preset, *["-"] * (len(_SOURCE_HEADER) - 2)]
    figures = [
        e.recall, e.false_per_100_frames, e.speed_rmse_mps, e.velocity_rmse_mps, e.centre_rmse_m,
        e.coverage, e.box_iou_median, e.surplus_boxes_per_100_frames, e.unflagged_misses,
        e.delay_median_s, e.identity_switches, e.mota, e.frames_degraded,
        e.frames_lost,
    ]  # fmt: skip
    return [spec, result.preset, *map(shown, figures)]
