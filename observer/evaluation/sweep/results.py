"""Results of a sweep, and the ranking of its combinations."""

from __future__ import annotations

import statistics
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import get_args

from observer.evaluation.choices import RankedBy
from observer.evaluation.evaluate import FIGURE_TITLES
from observer.evaluation.sweep.grid import Combination, Grid
from observer.evaluation.sweep.sources import SweepSource
from observer.evaluation.sweep.task import Outcome

# Figures that may rank combinations: title, and True if more of it is better.
RANKED_BY: Mapping[RankedBy, tuple[str, bool]] = {
    name: (FIGURE_TITLES[name], name in ("mota", "recall")) for name in get_args(RankedBy)
}


@dataclass(frozen=True)
class Row:
    """A combination over a source; ``outcome`` is None where the sweep did not get to it."""

    combination: Combination
    source: SweepSource
    outcome: Outcome | None

    @property
    def figures(self) -> Mapping[str, float | int | None]:
        """Figures that are known."""
        return {} if self.outcome is None else self.outcome.figures or {}


@dataclass(frozen=True)
class Sweep:
    """Result of ``SweepRun``.

    Attributes:
        rows: of every combination over every source, source by source.
        gate_m: greatest distance of an instance from its body.
        kept: tasks that an earlier sweep had finished.
    """

    grid: Grid
    sources: tuple[SweepSource, ...]
    combinations: tuple[Combination, ...]
    rows: tuple[Row, ...]
    gate_m: float
    version: str
    kept: int

    @property
    def failed(self) -> tuple[Row, ...]:
        """Rows that ended with an error."""
        return tuple(r for r in self.rows if r.outcome is not None and r.outcome.error)

    @property
    def left(self) -> int:
        """Number of tasks that the sweep did not get to."""
        return sum(r.outcome is None for r in self.rows)


@dataclass(frozen=True)
class Ranked:
    """A combination over all sources.

    Attributes:
        rank: from 1, by the mean of the figure; None where the figure is missing on a source
            that others have it on: means over different sources cannot be compared.
        means: over the sources, of every figure of ``RANKED_BY``; None where none is known.
        cost_ratio: to the preset ``default``, mean over the sources.
        judged: sources that it was evaluated on.
        best: no other is both better and cheaper (it lies on the Pareto front).
    """

    combination: Combination
    rank: int | None
    means: Mapping[RankedBy, float | None]
    cost_ratio: float | None
    judged: int
    best: bool = False


def ranking(sweep: Sweep, figure: RankedBy = "mota") -> tuple[Ranked, ...]:
    """Rank the combinations by this figure of ``RANKED_BY``, then by cost.

    Unranked ones are at the end, in the grid's order.
    """
    rows: dict[int, list[Row]] = defaultdict(list)
    for row in sweep.rows:
        if row.outcome is not None and row.outcome.error is None:
            rows[row.combination.number].append(row)
    known = {n: {r.source.digest for r in each if _known(r, figure)} for n, each in rows.items()}
    all_known = set().union(*known.values()) if known else set()
    ranked: list[tuple[float, float, Ranked]] = []
    unranked: list[Ranked] = []
    for combination in sweep.combinations:
        mine = rows[combination.number]
        means: dict[RankedBy, float | None] = {
            name: _mean([r.figures.get(name) for r in mine]) for name in RANKED_BY
        }
        cost = _mean([None if r.outcome is None else r.outcome.cost_ratio for r in mine])
        value = means[figure]
        if value is None or known.get(combination.number, set()) != all_known:
            unranked.append(Ranked(combination, None, means, cost, len(mine)))
            continue
        loss = -value if RANKED_BY[figure][1] else value
        dear = float("inf") if cost is None else cost
        ranked.append((loss, dear, Ranked(combination, 0, means, cost, len(mine))))
    ranked.sort(key=lambda each: each[:2])
    result, cheapest = [], float("inf")
    for rank, (_, dear, each) in enumerate(ranked, 1):
        # In this order a combination that is cheaper than all before is on the Pareto front.
        best = dear < cheapest
        cheapest = min(cheapest, dear)
        result.append(replace(each, rank=rank, best=best))
    return (*result, *unranked)


def _known(row: Row, figure: str) -> bool:
    return row.figures.get(figure) is not None


def _mean(values: Sequence[float | int | None]) -> float | None:
    known = [v for v in values if v is not None]
    return statistics.fmean(known) if known else None
