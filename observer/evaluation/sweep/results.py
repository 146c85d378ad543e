"""Results of a sweep, and the ranking of its combinations."""

from __future__ import annotations

import statistics
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import get_args

from observer.errors import InputError
from observer.evaluation.choices import ObservingFigure, RankedBy
from observer.evaluation.evaluate import FIGURE_TITLES
from observer.evaluation.sweep.crowds import SweepCrowd
from observer.evaluation.sweep.grid import Combination, Grid
from observer.evaluation.sweep.sources import SweepSource
from observer.evaluation.sweep.task import Outcome

# Figures that may rank combinations: title, and whether more is better.
OBSERVING: Mapping[RankedBy, tuple[str, bool]] = {
    name: (FIGURE_TITLES[name], name in ("mota", "recall")) for name in get_args(ObservingFigure)
}
DRIVING: Mapping[RankedBy, tuple[str, bool]] = {
    "time_ratio": ("time ratio", False),
    "contacts_per_m": ("contacts / m", False),
    "ahead_per_m": ("driven into / m", False),
    "reached": ("goals reached", True),
}
# The driving figure that serves as the cost of each.
_PAID_WITH: Mapping[RankedBy, RankedBy] = {
    "time_ratio": "contacts_per_m",
    "contacts_per_m": "time_ratio",
    "ahead_per_m": "time_ratio",
    "reached": "contacts_per_m",
}


@dataclass(frozen=True)
class Row:
    """A combination over a source; ``outcome`` is None if the sweep did not get to it."""

    combination: Combination
    source: SweepSource | SweepCrowd
    outcome: Outcome | None

    @property
    def figures(self) -> Mapping[str, float | int | None]:
        """Known figures."""
        return {} if self.outcome is None else self.outcome.figures or {}

    def cost(self, figure: RankedBy) -> float | None:
        """Return the cost for this figure: processing time, or another figure of driving."""
        if figure in _PAID_WITH:
            return self.figures.get(_PAID_WITH[figure])
        return None if self.outcome is None else self.outcome.cost_ratio


@dataclass(frozen=True)
class Sweep:
    """Result of ``SweepRun``.

    Attributes:
        rows: of every combination over every source, source by source.
        gate_m: highest distance of an instance from its body.
        kept: number of tasks that an earlier sweep had finished.
    """

    grid: Grid
    sources: tuple[SweepSource | SweepCrowd, ...]
    combinations: tuple[Combination, ...]
    rows: tuple[Row, ...]
    gate_m: float
    version: str
    kept: int

    @property
    def ranked_by(self) -> Mapping[RankedBy, tuple[str, bool]]:
        """Figures that may rank its combinations: title, and whether more is better."""
        return DRIVING if self.grid.driving else OBSERVING

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
        rank: from 1, by the mean of the figure; None if the figure is missing on a source on which
            others have it, as means over different sources cannot be compared.
        means: over the sources, of every figure of ``Sweep.ranked_by``; None if none is known.
        cost: mean over the sources: of processing relative to the preset ``default``, for driving
            as ``Row.cost`` and None if it is unknown or infinite on one of them.
        judged: number of sources on which it was evaluated.
        best: whether it is on the Pareto front: no other is both better and cheaper.
    """

    combination: Combination
    rank: int | None
    means: Mapping[RankedBy, float | None]
    cost: float | None
    judged: int
    best: bool = False


def ranking(sweep: Sweep, figure: RankedBy = "mota") -> tuple[Ranked, ...]:
    """Rank the combinations by this figure of ``Sweep.ranked_by``, then by cost.

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
            name: _mean([r.figures.get(name) for r in mine]) for name in sweep.ranked_by
        }
        costs = [r.cost(figure) for r in mine]
        cost = None if sweep.grid.driving and None in costs else _mean(costs)
        value = means[figure]
        if value is None or known.get(combination.number, set()) != all_known:
            unranked.append(Ranked(combination, None, means, cost, len(mine)))
            continue
        loss = -value if sweep.ranked_by[figure][1] else value
        dear = float("inf") if cost is None else cost
        ranked.append((loss, dear, Ranked(combination, 0, means, cost, len(mine))))
    ranked.sort(key=lambda each: each[:2])
    result, cheapest = [], float("inf")
    for rank, (_, dear, each) in enumerate(ranked, 1):
        # In this order a combination cheaper than all before it is on the Pareto front.
        best = dear < cheapest
        cheapest = min(cheapest, dear)
        result.append(replace(each, rank=rank, best=best))
    return (*result, *unranked)


def rankable(wanted: RankedBy | None, *, driving: bool) -> RankedBy:
    """Return the figure to rank by; the default one if none is given.

    Args:
        driving: whether the sweep is over crowds.

    Raises:
        InputError: such a sweep does not have this figure.
    """
    figures = DRIVING if driving else OBSERVING
    if wanted is None:
        return next(iter(figures))
    if wanted not in figures:
        over = "crowds" if driving else "sources with ground truth"
        raise InputError(f"{wanted} is not measured over {over}; rank by {', '.join(figures)}")
    return wanted


def cost_title(figure: RankedBy) -> str:
    """Return the title of a figure's cost."""
    paid = _PAID_WITH.get(figure)
    return "cost of observe relative to the preset default" if paid is None else DRIVING[paid][0]


def _known(row: Row, figure: str) -> bool:
    return row.figures.get(figure) is not None


def _mean(values: Sequence[float | int | None]) -> float | None:
    known = [v for v in values if v is not None]
    return statistics.fmean(known) if known else None
