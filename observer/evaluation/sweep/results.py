"""What a sweep found, and which of its combinations are best."""

from __future__ import annotations

import statistics
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from observer.evaluation.sweep.grid import Combination, Grid
from observer.evaluation.sweep.sources import SweepSource
from observer.evaluation.sweep.task import Outcome

RankedBy = Literal[
    "mota",
    "recall",
    "false_per_100_frames",
    "speed_rmse_mps",
    "velocity_rmse_mps",
    "centre_rmse_m",
    "delay_median_s",
]
# By which figure combinations may be ranked: how it is called, and whether more of it is better.
RANKED_BY: Mapping[RankedBy, tuple[str, bool]] = {
    "mota": ("MOTA", True),
    "recall": ("recall", True),
    "false_per_100_frames": ("false per 100 frames", False),
    "speed_rmse_mps": ("speed RMSE, m/s", False),
    "velocity_rmse_mps": ("velocity RMSE, m/s", False),
    "centre_rmse_m": ("position RMSE, centre, m", False),
    "delay_median_s": ("delay to first report, median, s", False),
}


@dataclass(frozen=True)
class Row:
    """One combination over one source; ``outcome`` is None where the sweep did not come to it."""

    combination: Combination
    source: SweepSource
    outcome: Outcome | None

    @property
    def figures(self) -> Mapping[str, float | int | None]:
        """Those that are known."""
        return {} if self.outcome is None else self.outcome.figures or {}


@dataclass(frozen=True)
class Sweep:
    """What ``run_sweep`` found.

    Attributes:
        rows: of every combination over every source, source by source.
        gate_m: how far an instance might lie from what it is.
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
        """Those that ended with an error."""
        return tuple(r for r in self.rows if r.outcome is not None and r.outcome.error)

    @property
    def left(self) -> int:
        """Tasks that the sweep did not come to."""
        return sum(r.outcome is None for r in self.rows)


@dataclass(frozen=True)
class Ranked:
    """One combination over all sources.

    Attributes:
        rank: from 1, by the mean of the figure; None where the figure is missing on a source
            that others have it on: means over different sources tell nothing of each other.
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
    """The combinations, the best by this figure of ``RANKED_BY`` first, then the cheaper one.

    What is not ranked stands at the end, in the grid's order.
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
        # In this order whoever is cheaper than all before is beaten by nobody.
        best = dear < cheapest
        cheapest = min(cheapest, dear)
        result.append(
            Ranked(each.combination, rank, each.means, each.cost_ratio, each.judged, best)
        )
    return (*result, *unranked)


def _known(row: Row, figure: str) -> bool:
    return row.figures.get(figure) is not None


def _mean(values: Sequence[float | int | None]) -> float | None:
    known = [v for v in values if v is not None]
    return statistics.fmean(known) if known else None
