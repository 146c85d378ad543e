"""Figure of a sweep's combinations: accuracy or driving against cost."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from observer.evaluation.choices import RankedBy
from observer.evaluation.sweep.results import Ranked, Sweep, cost_title
from observer.figures import DARK_GREY, GREY, INK, SERIES, plain_axes

# Number of points of the front that are labelled; more labels would overlap.
_NAMED = 12


def sweep_figure(sweep: Sweep, ranked: Sequence[Ranked], by: RankedBy) -> Figure:
    """Plot each combination as a point, means over the sources, and the Pareto front as a line.

    Args:
        by: the figure of ``Sweep.ranked_by`` that ranks them.
    """
    title, more = sweep.ranked_by[by]
    figure = Figure(figsize=(8.5, 5.6), layout="constrained", facecolor="white")
    axes = figure.add_subplot()
    points = [
        (each, each.cost, value)
        for each in ranked
        if each.rank is not None and each.cost is not None and (value := each.means[by]) is not None
    ]
    for number, preset in enumerate(sweep.grid.presets):
        mine = [(x, y) for each, x, y in points if each.combination.preset == preset]
        colour = SERIES[number % len(SERIES)]
        axes.plot(
            [x for x, _ in mine],
            [y for _, y in mine],
            linestyle="none", marker="o", markersize=6, color=colour, alpha=0.6, label=preset,
        )  # fmt: skip
    front = sorted(((x, y, each) for each, x, y in points if each.best), key=lambda point: point[0])
    axes.plot(
        [x for x, _, _ in front],
        [y for _, y, _ in front],
        color=INK, linewidth=1.2, marker="o", markersize=9, markerfacecolor="none",
        label="Pareto front: no other is both better and cheaper",
    )  # fmt: skip
    for x, y, each in front[-_NAMED:]:
        name, offset = str(each.combination.number), "offset points"
        axes.annotate(name, (x, y), xytext=(6, 6), textcoords=offset, fontsize=8.5)
    if not sweep.grid.driving:
        axes.axvline(1.0, color=GREY, linewidth=1, linestyle="--", zorder=1)
    axes.set_xlabel(cost_title(by))
    axes.set_ylabel(f"{title} ({'higher' if more else 'lower'} is better)")
    heading = "Accuracy against cost"
    if sweep.grid.driving:
        heading = f"Driving: {title} against {cost_title(by)}"
    axes.set_title(heading, loc="left", fontsize=11, fontweight="bold")
    counts = f"{len(points)} combinations, {len(sweep.sources)} sources"
    axes.set_title(counts, loc="right", fontsize=9, color=DARK_GREY)
    axes.legend(frameon=False, fontsize=9)
    plain_axes(axes, "both")
    return figure
