"""Tables of a sweep's results: Parquet and CSV for machines, Markdown for people."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from observer.evaluation.choices import RankedBy
from observer.evaluation.evaluate import Evaluation, markdown_table, shown
from observer.evaluation.result_files import whole_result
from observer.evaluation.sweep.crowds import SweepCrowd
from observer.evaluation.sweep.results import DRIVING, Ranked, Row, Sweep, cost_title
from observer.evaluation.sweep.sources import SweepSource
from observer.navigation.parameters import AllParameters
from observer.parameters import ParameterValue

# Most rows in Markdown; the CSV file has all.
_MARKDOWN_ROWS = 100
_FAILED_LISTED = 20


def ranking_markdown(sweep: Sweep, ranked: Sequence[Ranked], figure: RankedBy) -> str:
    """Return the combinations ranked by a figure of ``Sweep.ranked_by``, and the failed tasks."""
    title, more = sweep.ranked_by[figure]
    names = list(sweep.grid.lists)
    header = ["rank", "combination", "preset", *names]
    header += [title for title, _ in sweep.ranked_by.values()]
    # The cost of driving is already among these figures.
    header += [*(["cost / default"] if not sweep.grid.driving else []), "sources"]
    rows = [
        [
            ("-" if each.rank is None else str(each.rank)) + (" *" if each.best else ""),
            str(each.combination.number),
            each.combination.preset,
            *(_value(each.combination.values[name]) for name in names),
            *(shown(each.means[name]) for name in sweep.ranked_by),
            *([shown(each.cost)] if not sweep.grid.driving else []),
            str(each.judged),
        ]
        for each in ranked[:_MARKDOWN_ROWS]
    ]
    fixed = ", ".join(f"{name} = {_value(value)}" for name, value in sweep.grid.fixed.items())
    sources = ", ".join(f"{s.name} ({s.extent})" for s in sweep.sources)
    parts = [
        "# Sweep\n",
        f"{len(sweep.combinations)} of {sweep.grid.count} combinations over {len(sweep.sources)} "
        f"sources, {_judged(sweep)}version {sweep.version}. Means over the sources, ranked by "
        f"{title} ({'higher' if more else 'lower'} is better). {_explained(sweep, figure)} "
        "Combinations marked with an asterisk are Pareto-optimal: no other is both better and "
        "cheaper.\n",
        f"Sources: {sources}.\n",
    ]
    parts += [f"Common to all: {fixed}.\n"] * bool(fixed)
    parts += [markdown_table(header, rows)]
    if len(ranked) > _MARKDOWN_ROWS:
        parts += [f"{len(ranked) - _MARKDOWN_ROWS} more are in ranking.csv.\n"]
    if sweep.left:
        parts += [f"The sweep was interrupted with {sweep.left} of {len(sweep.rows)} tasks left.\n"]
    if sweep.failed:
        parts += ["## Failed\n", "\n".join(_failures(sweep)) + "\n"]
    return "\n".join(parts)


def _judged(sweep: Sweep) -> str:
    return "" if sweep.grid.driving else f"matched within {sweep.gate_m:g} m, "


def _explained(sweep: Sweep, figure: RankedBy) -> str:
    if not sweep.grid.driving:
        return "Cost is that of `observe` relative to the preset default on the same frames."
    return (
        "Time ratio: median time to the goal relative to that without people at the default speed; "
        "a goal that was not reached counts as the time limit. Contacts: people touched while the "
        "robot moved; driven into: people among them that the robot drove into. The cost is "
        f"{cost_title(figure)}."
    )


def _failures(sweep: Sweep) -> list[str]:
    listed = [
        f"- combination {r.combination.number} over {r.source.name}: {r.outcome.error}"
        for r in sweep.failed[:_FAILED_LISTED]
        if r.outcome is not None
    ]
    more = len(sweep.failed) - _FAILED_LISTED
    return listed + [f"- and {more} more, in results.parquet"] * (more > 0)


def ranking_csv(sweep: Sweep, ranked: Sequence[Ranked]) -> str:
    """Return all combinations in order of rank; unknown values are empty."""
    names = list(sweep.grid.lists)
    text = io.StringIO()
    out = csv.writer(text, lineterminator="\n")
    cost = [] if sweep.grid.driving else ["cost_ratio"]
    out.writerow(
        ["rank", "combination", "preset", *names, *sweep.ranked_by, *cost, "sources", "best"]
    )
    for each in ranked:
        row: list[Any] = [each.rank, each.combination.number, each.combination.preset]
        row += [_value(each.combination.values[name]) for name in names]
        row += [each.means[name] for name in sweep.ranked_by]
        row += [each.cost] * len(cost)
        out.writerow([*row, each.judged, int(each.best)])
    return text.getvalue()


def write_parquet(sweep: Sweep, path: Path) -> None:
    """Write a row for each combination and source; unknown values are null.

    Columns: ``combination, preset, source, frames_planned, status`` (``finished``, ``failed`` or
    ``left``), ``error``, the varied parameters by their dotted names, every figure of
    ``Evaluation``, ``frames_observed, frames_skipped, median_ms, cost_ratio, cpu_s, wall_s,
    version``. For driving ``runs_planned`` replaces ``frames_planned``, and the figures are those
    of ``DRIVING``.

    Raises:
        InputError: the file cannot be written.
    """
    import pyarrow  # type: ignore[import-untyped]
    import pyarrow.parquet  # type: ignore[import-untyped]

    declared = {entry["name"]: entry["type"] for entry in AllParameters.declared()}
    types = {
        "text": pyarrow.string(),
        "choice": pyarrow.string(),
        "boolean": pyarrow.bool_(),
        "integer": pyarrow.int64(),
        "number": pyarrow.float64(),
    }
    observing = {
        **{f.name: "integer" if f.type in ("int", int) else "number" for f in fields(Evaluation)},
        **dict.fromkeys(("frames_observed", "frames_skipped"), "integer"),
        **dict.fromkeys(("median_ms", "cost_ratio"), "number"),
    }
    driving = sweep.grid.driving
    kinds: dict[str, str] = {
        **dict.fromkeys(
            ("combination", "runs_planned" if driving else "frames_planned"), "integer"
        ),
        **dict.fromkeys(("preset", "source", "status", "error", "version"), "text"),
        **{name: declared[name] for name in sweep.grid.lists},
        **({str(name): "number" for name in DRIVING} if driving else observing),
        **dict.fromkeys(("cpu_s", "wall_s"), "number"),
    }
    rows = [_flat(row, sweep.version) for row in sweep.rows]
    table = pyarrow.table(
        {
            name: pyarrow.array([row.get(name) for row in rows], types[kind])
            for name, kind in kinds.items()
        }
    )
    with whole_result(path) as part:
        pyarrow.parquet.write_table(table, part)


def _flat(row: Row, version: str) -> Mapping[str, Any]:
    outcome = row.outcome
    flat: dict[str, Any] = {
        "combination": row.combination.number,
        "preset": row.combination.preset,
        "source": row.source.name,
        **_planned(row.source),
        "status": "left" if outcome is None else "failed" if outcome.error else "finished",
        "version": version,
        **row.combination.values,
        **row.figures,
    }
    if outcome is None or outcome.error:
        return flat | {"error": None if outcome is None else outcome.error}
    return flat | {
        "frames_observed": outcome.frames,
        "frames_skipped": outcome.skipped,
        "median_ms": outcome.median_ms,
        "cost_ratio": outcome.cost_ratio,
        "cpu_s": outcome.cpu_s,
        "wall_s": outcome.wall_s,
    }


def _planned(source: SweepSource | SweepCrowd) -> Mapping[str, int]:
    if isinstance(source, SweepCrowd):
        return {"runs_planned": source.runs}
    return {"frames_planned": source.frames}


def _value(value: ParameterValue) -> str:
    return str(value).lower() if isinstance(value, bool) else f"{value}"
