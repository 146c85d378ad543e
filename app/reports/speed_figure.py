"""Figure 17: the obstacle's speed as observed, true, commanded and from encoders."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from app.reports.gathering import Curve, Gathered
from observer.evaluation.gaps import broken
from observer.evaluation.speed_errors import SeenMotion
from observer.figures import BLUE, INK, ORANGE, PURPLE, TEAL, plain_axes
from observer.intervals import SIGMAS_95
from observer.jsonl import ObservationLine

# Tracks with fewer samples are drawn without their number.
_NAMED_FROM = 5
_LEGEND_COLUMNS = 5
_LEGEND_ROW_PT = 13.0
_OTHER_SOURCES = {"true": (ORANGE, "--"), "commanded": (INK, ":"), "encoder": (TEAL, "-.")}


def speed_figure(runs: Sequence[tuple[str, Gathered]], highest_mps: float | None = None) -> Figure:
    """Draw one chart for each experiment, with its title.

    Args:
        highest_mps: upper end of all charts; None for individual ends.
    """
    figure = Figure(figsize=(9.6, 3.5 * len(runs)), layout="constrained", facecolor="white")
    charts = figure.subplots(len(runs), 1, squeeze=False)
    for axes, (title, gathered) in zip(charts.flat, runs, strict=True):
        legend_rows = _chart(axes, gathered)
        if gathered.span is not None and gathered.span[0] < gathered.span[1]:
            # The whole run, even where no speed is known yet.
            axes.set_xlim(*gathered.span)
        if highest_mps is not None:
            axes.set_ylim(top=highest_mps)
        axes.set_title(title, fontsize=10, loc="left", pad=6 + _LEGEND_ROW_PT * legend_rows)
        axes.set_ylabel("speed, m/s")
    charts.flat[-1].set_xlabel("time on the source's clock, s")
    return figure


def _chart(axes: Axes, gathered: Gathered) -> int:
    """Draw one chart.

    Returns:
        The number of rows in the legend.
    """
    stray = "unmatched track" if gathered.true else "estimate"
    groups = ((gathered.seen, BLUE, "estimate"), (gathered.unmatched, PURPLE, stray))
    for motions, color, label in groups:
        for number, motion in enumerate(motions):
            _seen(axes, motion, color, None if number else label)
    _name_starts(axes, [*gathered.seen, *gathered.unmatched])
    _mark_segments(axes, gathered.lines)
    for true in gathered.true:
        _line(axes, Curve(f"{true.body}, ground truth", true.times, true.speeds), "true")
    for curve in gathered.commanded:
        _line(axes, curve, "commanded")
    for curve in gathered.encoder:
        _line(axes, curve, "encoder")
    axes.margins(y=0.12)
    axes.set_ylim(bottom=0)
    plain_axes(axes)
    entries = len(axes.get_legend_handles_labels()[0])
    if entries:
        # Above the chart, where it hides no curve, and below the title, which may be long.
        axes.legend(
            loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False, fontsize=8,
            ncols=_LEGEND_COLUMNS, borderaxespad=0.2, borderpad=0.2,
        )  # fmt: skip
    return -(-entries // _LEGEND_COLUMNS)


def _seen(axes: Axes, motion: SeenMotion, color: str, label: str | None) -> None:
    times, speeds, stds = broken(motion.times, motion.speeds, motion.stds)
    axes.plot(times, speeds, color=color, linewidth=1.5, label=label, zorder=4)
    known = np.isfinite(stds)
    low = np.maximum(speeds - SIGMAS_95 * stds, 0.0)
    axes.fill_between(
        times, low, speeds + SIGMAS_95 * stds, where=list(known), color=color, alpha=0.18,
        linewidth=0, label=None if label is None else "95 % interval", zorder=2,
    )  # fmt: skip
    if len(motion.times) >= _NAMED_FROM:
        # Start of a track, so that identity switches are visible.
        axes.plot(motion.times[0], motion.speeds[0], "o", color=color, markersize=3.5, zorder=5)
        axes.annotate(
            motion.track, (motion.times[0], motion.speeds[0]), xytext=(3, 4),
            textcoords="offset points", fontsize=7, color=color, annotation_clip=True,
        )  # fmt: skip


def _name_starts(axes: Axes, motions: Sequence[SeenMotion]) -> None:
    """Explain in the legend the dots at which tracks start, if there are any."""
    if any(len(motion.times) >= _NAMED_FROM for motion in motions):
        axes.plot([], [], "o", color=INK, markersize=3.5, label="start of a track, segment:number")


def _mark_segments(axes: Axes, lines: Iterable[ObservationLine]) -> None:
    """Mark where a segment begins after the first, as at a rewind: all its tracks are new."""
    begins: dict[int, float] = {}
    for line in lines:
        begins.setdefault(line["segment"], line["time"])
    for number, time in enumerate(sorted(begins.values())[1:]):
        label = None if number else "new segment, with new tracks"
        axes.axvline(time, color=INK, linestyle=":", linewidth=1.0, label=label, zorder=1)


def _line(axes: Axes, curve: Curve, kind: str) -> None:
    color, style = _OTHER_SOURCES[kind]
    times, speeds = broken(curve.times, curve.speeds)
    axes.plot(times, speeds, style, color=color, linewidth=1.4, label=curve.label, zorder=3)
