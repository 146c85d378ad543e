"""Markdown tables of the navigation benchmark."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from observer.evaluation.navigation.results import NavigationBenchmark, Summary
from observer.evaluation.navigation.run import IN_TIME

_HEAD = (
    "driver", "sees by", "people", "per m²", "declared risk / m", "runs",
    f"reached in {IN_TIME:g}x", "time ratio", "time / oracle", "contacts moving",
    "driven into", "avoidable", "contacts standing", "of these seen before", "guard stops / run",
    "stopped by guard", "waited",
)  # fmt: skip

_PERCEPTION_HEAD = (
    "driver", "sees by", "people", "per m²", "frames", "usable", "recall", "false / 100 frames",
    "surplus / 100 frames", "velocity error, median m/s", "RMSE m/s", "within 95 %",
)  # fmt: skip

# People of a prediction, by whether they were seen in its frame.
_SIGHT = {True: "in view", False: "out of view"}


def navigation_markdown(result: NavigationBenchmark) -> str:
    """Return the tables of results, of the guard's stops and of the predictions."""
    parts = [_table(_HEAD, [_row(each) for each in result.summaries]), _NOTE]
    if result.changed:
        changed = ", ".join(f"{name} = {value}" for name, value in result.changed.items())
        parts += [f"Not at their defaults: {changed}."]
    parts += ["## Stops by the guard", _stops(result.summaries)]
    perceptions = [_perception(each) for each in result.summaries]
    parts += ["## Perception", _table(_PERCEPTION_HEAD, perceptions)]
    rows = [
        (_SIGHT[each.seen], f"{each.ahead_s:g} s", str(each.predictions), _percent(each.share))
        for each in result.coverage
    ]
    parts += [
        "## Predictions",
        _table(("people", "ahead", "predictions", "within the 95 % region"), rows),
    ]
    return "\n\n".join(parts) + "\n"


_NOTE = (
    "*Time ratio*: median time to the goal relative to that without people; a goal that was not "
    "reached counts as the longest. *Time / oracle*: relative to an oracle that knows where "
    "everybody will walk. *Contacts moving*: people touched while the robot drove or turned, or "
    "who were touching it when it started; *driven into*: those of them the robot drove into, "
    "while the others walked into its side or back; *avoidable*: those of them who could have been "
    "seen a second before. *Contacts standing*: people who walked into the stationary robot; *of "
    "these seen before*: those who could have been seen a second before. *Stopped by guard*, "
    "*waited*: share of the time for which the guard stopped the robot, or the driver waited."
)


def _row(one: Summary) -> tuple[str, ...]:
    setting, contacts = one.setting, one.contacts
    risk = "–" if setting.risk_per_metre is None else f"{setting.risk_per_metre:g}"
    per_m = one.contacts_per_m
    ahead = one.ahead_per_m
    return (
        setting.driver,
        setting.sees,
        people_word(setting.kind),
        f"{setting.density_per_m2:g}",
        risk,
        str(one.runs),
        _percent(one.reached / one.runs),
        _ratio(one.time_ratio),
        "–" if setting.kind else _ratio(one.oracle_ratio),
        f"{contacts.moving}" + ("" if per_m is None else f" ({per_m:.4f} / m)"),
        f"{contacts.ahead}"
        + ("" if ahead is None else f" ({ahead[0]:.4f} / m, {ahead[1]:.4f} to {ahead[2]:.4f})"),
        str(contacts.avoidable),
        str(contacts.standing),
        str(contacts.standing_seen),
        f"{sum(one.stops.values()) / one.runs:.1f}",
        _percent(one.stopped_s / one.total_s),
        _percent(one.waited_s / one.total_s),
    )


def _perception(one: Summary) -> tuple[str, ...]:
    setting, perception = one.setting, one.perception
    named = (setting.driver, setting.sees, people_word(setting.kind), f"{setting.density_per_m2:g}")
    if perception is None:
        return (*named, *["–"] * (len(_PERCEPTION_HEAD) - len(named)))
    errors = perception.velocity_median, perception.velocity_rmse
    return (
        *named,
        str(perception.frames),
        _percent(perception.usable),
        _percent(perception.recall),
        f"{perception.false:.1f}",
        f"{perception.surplus:.1f}",
        *("–" if each is None else f"{each:.2f}" for each in errors),
        _percent(perception.coverage),
    )


def _ratio(ratio: float | None) -> str:
    return f"> {IN_TIME:g}" if ratio is None else f"{ratio:.2f}"


def _stops(summaries: Sequence[Summary]) -> str:
    """Table of reasons by driver, people and perception, combining all densities and risks."""
    columns = list(dict.fromkeys(_column(each) for each in summaries))
    counts: dict[str, Counter[str]] = {}
    for one in summaries:
        for reason, count in one.stops.items():
            counts.setdefault(reason, Counter())[_column(one)] += count
    ordered = sorted(counts.items(), key=lambda item: -item[1].total())
    rows = [(reason, *(str(by[column]) for column in columns)) for reason, by in ordered]
    return _table(("reason", *columns), rows)


def _column(one: Summary) -> str:
    by = ", by images" if one.setting.sees == "images" else ""
    return f"{one.setting.driver}, {people_word(one.setting.kind)}{by}"


def people_word(kind: bool) -> str:
    """Return the word for people who avoid the robot, or ignore it."""
    return "kind" if kind else "hard"


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100 * share:.0f} %"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
