"""Figure of a benchmark's result: presets side by side."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, NullFormatter

from observer.evaluation.breakdown import GROUPINGS, Group
from observer.evaluation.result_files import whole_result
from observer.evaluation.results import Benchmark, PresetResult, SourceResult
from observer.figures import DARK_GREY, GREY, SERIES, figure_bytes, plain_axes
from observer.opening import simulated_world, source_kind

_MARKERS = ("o", "s", "^", "D", "v")
_RECALL = 0.97
_VELOCITY_IDEAL, _VELOCITY_FAULTY = 0.03, 0.08
_FALSE_PER_100 = 0.5
_CLASSES = ("by_range", "by_speed", "by_direction")


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure in the format of its suffix; an incomplete one never replaces another.

    Args:
        path: ending in ``.png``, ``.svg`` or ``.pdf``.

    Raises:
        InputError: the file cannot be written.
    """
    content = figure_bytes(figure, path.stem, path.suffix.lower().removeprefix("."))
    with whole_result(path) as part:
        part.write_bytes(content)


def benchmark_figure(result: Benchmark) -> Figure:
    """Plot recall and velocity error by class, false instances by source, and cost by stage.

    Figures that were not measured get no panel.
    """
    presets = [p for p in result.presets if p.breakdown is not None]
    timed = [p for p in result.presets if p.timings]
    names = [p.preset for p in result.presets]
    by_source = _false_by_source(result.sources)
    stages = _stages(timed)
    upper = 5.8 if presets else 0.0
    lower = 0.9 + 0.24 * max(len(by_source), len(stages), 4) if by_source or stages else 0.0
    figure = Figure(
        figsize=(13, max(upper + lower, 1.0) + 0.5),
        layout=ConstrainedLayoutEngine(h_pad=0.08, w_pad=0.08, hspace=0.04),
        facecolor="white",
    )
    heights = [height for height in (upper, lower) if height > 0]
    _legend(figure, names, result.sources)
    if not heights:
        return figure
    parts = iter(figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False).flat)
    if presets:
        _accuracy(next(parts), presets, names)
    if lower > 0:
        part, places = next(parts), 1 + bool(by_source and stages)
        if by_source:
            _false(part.add_subplot(1, places, 1), by_source, names)
        if stages:
            _cost(part.add_subplot(1, places, places), timed, stages, names)
    return figure


def _accuracy(part: SubFigure, presets: Sequence[PresetResult], names: Sequence[str]) -> None:
    panels = part.subplots(2, len(_CLASSES))
    for column, attribute in enumerate(_CLASSES):
        _recall(panels[0, column], presets, attribute, names)
        _velocity(panels[1, column], presets, attribute, names)


_TITLE: Mapping[str, Any] = {"loc": "left", "fontsize": 11, "fontweight": "bold"}


def _recall(
    axes: Axes, presets: Sequence[PresetResult], attribute: str, names: Sequence[str]
) -> None:
    _points(axes, presets, attribute, "recall", names)
    axes.set_ylim(-0.03, 1.06)
    _horizontal_target(axes, _RECALL)
    axes.set_ylabel("recall")
    axes.set_title(f"Recall by {GROUPINGS[attribute]}", **_TITLE)


def _velocity(
    axes: Axes, presets: Sequence[PresetResult], attribute: str, names: Sequence[str]
) -> None:
    errors = _points(axes, presets, attribute, "velocity_rmse_mps", names)
    low, high = min([v for v in errors if v > 0], default=1.0), max(errors, default=0.0)
    axes.set_yscale("log")
    axes.set_ylim(min(low / 1.3, 0.015), max(1.3 * high, 0.2))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    ticks = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20)
    axes.set_yticks([t for t in ticks if axes.get_ylim()[0] <= t <= axes.get_ylim()[1]])
    _horizontal_target(axes, _VELOCITY_IDEAL, "ideal")
    _horizontal_target(axes, _VELOCITY_FAULTY, "faulty")
    axes.set_ylabel("velocity RMSE, m/s")
    axes.set_title(f"Velocity error by {GROUPINGS[attribute]}", **_TITLE)


def _points(
    axes: Axes, presets: Sequence[PresetResult], attribute: str, figure: str, names: Sequence[str]
) -> list[float]:
    """Draw one figure of all presets, and return the known values."""
    labels: list[str] = []
    known: list[float] = []
    for p in presets:
        groups: tuple[Group, ...] = getattr(p.breakdown, attribute)
        labels = [f"{g.label}\nn = {g.count}" for g in groups]
        values = [np.nan if (v := getattr(g, figure)) is None else v for g in groups]
        known += [v for v in values if not np.isnan(v)]
        number = names.index(p.preset)
        places = np.arange(len(values)) + _apart(number, len(names))
        axes.plot(places, values, linewidth=1.4, **_style(number))
    axes.set_xticks(range(len(labels)), labels, fontsize=8.5)
    axes.set_xlim(-0.4, len(labels) - 0.6)
    plain_axes(axes, "y")
    return known


def _false(
    axes: Axes, by_source: Sequence[tuple[str, dict[str, float]]], names: Sequence[str]
) -> None:
    places = np.arange(len(by_source))
    for number, name in enumerate(names):
        values = [each.get(name, np.nan) for _, each in by_source]
        axes.plot(
            values, places + 1.5 * _apart(number, len(names)), linestyle="none", **_style(number)
        )
    axes.set_xscale("symlog", linthresh=1)
    highest = max((v for _, each in by_source for v in each.values()), default=0.0)
    axes.set_xlim(-0.08, max(2.0, 1.4 * highest))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    ticks = [0, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000]
    axes.set_xticks([t for t in ticks if t <= axes.get_xlim()[1]])
    axes.axvline(_FALSE_PER_100, color=GREY, linewidth=1, linestyle="--", zorder=1)
    axes.set_yticks(places, [label for label, _ in by_source], fontsize=8.5)
    axes.set_ylim(len(by_source) - 0.4, -0.6)
    axes.set_xlabel("instances per 100 frames (linear below 1)")
    axes.set_title("False instances by source", **_TITLE)
    plain_axes(axes, "both")


def _cost(
    axes: Axes, presets: Sequence[PresetResult], stages: Sequence[str], names: Sequence[str]
) -> None:
    thickness = 0.8 / len(presets)
    for row, p in enumerate(presets):
        number = names.index(p.preset)
        for place, stage in enumerate(stages):
            ms = _stage_ms(p, stage)
            if ms is None:
                continue
            y = place + (row - (len(presets) - 1) / 2) * thickness
            colour = SERIES[number % len(SERIES)]
            axes.barh(y, ms, height=0.9 * thickness, color=colour, zorder=2)
            axes.text(ms, y, f" {ms:.1f}", va="center", fontsize=8, color=DARK_GREY)
    axes.set_yticks(range(len(stages)), [_WORDS.get(s, s.replace("_", " ")) for s in stages])
    axes.tick_params(axis="y", labelsize=8.5)
    axes.set_ylim(len(stages) - 0.4, -0.6)
    axes.set_xlim(0, axes.get_xlim()[1] * 1.08)
    axes.set_xlabel("ms per frame, median")
    ratios = [f"{p.preset} {p.opencv.ratio:.1f}" for p in presets if p.opencv is not None]
    note = f"   whole step / OpenCV: {', '.join(ratios)}" if ratios else ""
    axes.set_title("Cost by stage", **_TITLE)
    axes.set_title(note, loc="right", fontsize=9, color=DARK_GREY)
    plain_axes(axes, "x")


_OPENCV = "opencv"
_WORDS = {"total": "whole step", _OPENCV: "OpenCV calls only"}


def _stages(presets: Iterable[PresetResult]) -> list[str]:
    presets = list(presets)
    stages = list(dict.fromkeys(s for p in presets for s in p.timings if s != "total"))
    if stages:
        stages += ["total"]
    return stages + [_OPENCV] * any(p.opencv is not None for p in presets)


def _stage_ms(result: PresetResult, stage: str) -> float | None:
    if stage == _OPENCV:
        return None if result.opencv is None else result.opencv.timing.median_ms
    return result.timings[stage].median_ms if stage in result.timings else None


def _false_by_source(sources: Sequence[SourceResult]) -> list[tuple[str, dict[str, float]]]:
    """Return the false instances per 100 frames by preset for each scenario, over all its seeds."""
    false: dict[str, dict[str, list[int]]] = {}
    for s in sources:
        if s.evaluation is None or s.evaluation.frames == 0:
            continue
        spec = s.source.spec
        simulated = source_kind(spec) == "simulated"
        label = (simulated_world(spec)[0] if simulated else spec).replace("_", " ")
        if s.source.declares == "faulty":
            label += " (faulty)"
        sums = false.setdefault(label, {}).setdefault(s.preset, [0, 0])
        sums[0] += s.evaluation.false
        sums[1] += s.evaluation.frames
    return [
        (label, {preset: 100 * count / frames for preset, (count, frames) in each.items()})
        for label, each in sorted(false.items(), key=lambda item: item[0].endswith("(faulty)"))
    ]


def _legend(figure: Figure, names: Sequence[str], sources: Sequence[SourceResult]) -> None:
    handles = [Line2D([], [], linewidth=1.4, **_style(i)) for i in range(len(names))]
    handles += [Line2D([], [], color=GREY, linewidth=1, linestyle="--")]
    figure.legend(
        handles,
        [*names, "target"],
        loc="outside upper left",
        ncols=len(handles),
        frameon=False,
        fontsize=11,
    )
    first = [s for s in sources if s.preset == names[0]]
    counts = f"{len(first)} sources, {sum(s.frames for s in first)} frames per preset"
    figure.text(0.993, 0.995, counts, ha="right", va="top", fontsize=9, color=DARK_GREY)


def _apart(number: int, count: int) -> float:
    """Return the offset that keeps marks of equal values side by side."""
    return 0.12 * (number - (count - 1) / 2)


def _style(number: int) -> dict[str, Any]:
    return {
        "color": SERIES[number % len(SERIES)],
        "marker": _MARKERS[number % len(_MARKERS)],
        "markersize": 6.5,
        "zorder": 3,
    }


def _horizontal_target(axes: Axes, value: float, label: str = "") -> None:
    axes.axhline(value, color=GREY, linewidth=1, linestyle="--", zorder=1)
    if label:
        place: Mapping[str, Any] = {"transform": axes.get_yaxis_transform(), "ha": "right"}
        axes.text(1.0, value, label, va="bottom", fontsize=8, color=DARK_GREY, **place)
