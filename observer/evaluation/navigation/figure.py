"""Figure of measured contacts against declared risk."""

from __future__ import annotations

from matplotlib.figure import Figure

from observer.evaluation.navigation.results import NavigationBenchmark, rate
from observer.evaluation.navigation.tables import people_word
from observer.figures import DARK_GREY, GREY, SERIES, plain_axes

_MARKERS = {False: "o", True: "s"}
_APART = 1.06


def navigation_figure(result: NavigationBenchmark) -> Figure:
    """Plot contacts per metre over the declared risk per metre, with 95 % intervals.

    All densities are combined; the few runs that use images are left out. Without any contact only
    the upper limit is drawn.
    """
    figure = Figure(figsize=(7.5, 5.6), layout="constrained", facecolor="white")
    axes = figure.add_subplot()
    sums: dict[tuple[bool, float], tuple[int, float]] = {}
    for one in result.summaries:
        risk = one.setting.risk_per_metre
        if risk is None or one.setting.sees != "model":
            continue
        count, driven_m = sums.get((one.setting.kind, risk), (0, 0.0))
        sums[one.setting.kind, risk] = count + one.contacts.ahead, driven_m + one.driven_m
    values = [risk for _, risk in sums]
    for (kind, risk), (count, driven_m) in sorted(sums.items()):
        if driven_m <= 0:
            continue
        most_likely, low, high = rate(count, driven_m)
        # Draw both kinds side by side.
        x = risk * (_APART if kind else 1 / _APART)
        colour = SERIES[int(kind)]
        if count:
            axes.errorbar(
                x, most_likely, [[most_likely - low], [high - most_likely]],
                color=colour, marker=_MARKERS[kind], markersize=6.5, capsize=4,
            )  # fmt: skip
            values += [low, high]
        else:
            axes.plot(x, high, color=colour, marker="v", markersize=6.5, linestyle="none")
            values.append(high)
    for kind in sorted({kind for kind, _ in sums}):
        colour, label = SERIES[int(kind)], f"{people_word(kind)} people"
        axes.plot([], [], color=colour, marker=_MARKERS[kind], linestyle="none", label=label)
    axes.plot(
        [], [], color=DARK_GREY, marker="v", linestyle="none", label="no contact: upper limit"
    )
    positive = [value for value in values if value > 0] or [1e-3]
    ends = min(positive) / 2, max(positive) * 2
    axes.plot(ends, ends, color=GREY, linewidth=1, linestyle="--", label="as declared")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("declared risk, contacts per metre")
    axes.set_ylabel("people that the robot drove into, per metre")
    axes.set_title("Contacts against declared risk", loc="left", fontsize=11, fontweight="bold")
    drawn = [s for s in result.summaries if s.setting.driver == "planner"]
    runs = sum(each.runs for each in drawn if each.setting.sees == "model")
    axes.set_title(f"{runs} runs, 95 % intervals", loc="right", fontsize=9, color=DARK_GREY)
    axes.legend(frameon=False, fontsize=9)
    plain_axes(axes, "both")
    return figure
