"""Ranking, tables and figure of a made-up sweep."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest

from observer.evaluation.evaluate import Evaluation
from observer.evaluation.figure import save_figure
from observer.evaluation.sources import BenchmarkSource
from observer.evaluation.sweep.figure import sweep_figure
from observer.evaluation.sweep.grid import grid_from_text
from observer.evaluation.sweep.results import Row, Sweep, ranking
from observer.evaluation.sweep.sources import SweepSource
from observer.evaluation.sweep.tables import ranking_csv, ranking_markdown, write_parquet
from observer.evaluation.sweep.task import Outcome

GRID = grid_from_text(
    "set: {tracking.gate: 3}\nevidence.radius_px: [20, 26]\nego_motion.model: [rigid, affine]",
    "grid.yaml",
)


def source(name: str) -> SweepSource:
    return SweepSource(name, BenchmarkSource(name, None, "everything", 50), 50, name)


def outcome(mota: float | None, cost: float | None, recall: float | None = None) -> Outcome:
    names = Evaluation.__dataclass_fields__
    figures: dict[str, float | int | None] = dict.fromkeys(names)
    figures |= {"frames": 50, "mota": mota, "recall": recall}
    return Outcome(
        frames=50, figures=figures, median_ms=9.0, cost_ratio=cost, cpu_s=1.0, wall_s=1.5
    )


# Combination number -> outcomes on the sources a and b.
OUTCOMES = {
    1: (outcome(0.5, 1.0, 0.2), outcome(0.7, 1.2, 0.4)),
    2: (outcome(0.9, 3.0, 0.1), outcome(0.9, 3.2, 0.1)),
    3: (outcome(0.95, 2.0), Outcome(error="it broke")),
    4: (outcome(0.4, 1.5, 0.9), outcome(0.4, 1.5, 0.9)),
}


@pytest.fixture
def sweep() -> Sweep:
    combinations = GRID.chosen()
    sources = (source("a"), source("b"))
    rows = [
        Row(c, each, OUTCOMES[c.number][i]) for i, each in enumerate(sources) for c in combinations
    ]
    return Sweep(GRID, sources, combinations, tuple(rows), 0.5, "1", 0)


def test_best_mean_is_first_and_the_front_is_undominated(sweep: Sweep) -> None:
    ranked = ranking(sweep)
    assert [(r.combination.number, r.rank) for r in ranked] == [(2, 1), (1, 2), (4, 3), (3, None)]
    assert ranked[1].means["mota"] == pytest.approx(0.6)
    assert ranked[1].cost == pytest.approx(1.1)
    # The third is both worse and more expensive than the second.
    assert [r.best for r in ranked] == [True, True, False, False]
    assert [r.judged for r in ranked] == [2, 2, 2, 1]


def test_lower_is_better_figures_rank_ties_by_cost(sweep: Sweep) -> None:
    falses = {1: 2.0, 2: 1.0, 3: 0.0, 4: 2.0}
    rows = []
    for row in sweep.rows:
        assert row.outcome is not None
        figures = {"false_per_100_frames": falses[row.combination.number]}
        rows.append(replace(row, outcome=replace(row.outcome, figures=figures, error=None)))
    ranked = ranking(replace(sweep, rows=tuple(rows)), "false_per_100_frames")
    assert [r.combination.number for r in ranked] == [3, 2, 1, 4]
    assert [r.best for r in ranked] == [True, False, True, False]


def test_source_without_the_figure_disqualifies_no_combination(sweep: Sweep) -> None:
    rows = []
    for row in sweep.rows:
        assert row.outcome is not None
        if row.source.name == "b":
            row = replace(row, outcome=outcome(None, 1.0))
        rows.append(row)
    ranked = ranking(replace(sweep, rows=tuple(rows)))
    assert [r.combination.number for r in ranked] == [3, 2, 1, 4]
    assert all(r.rank is not None for r in ranked)


def test_interrupted_sweep_ranks_finished_combinations(sweep: Sweep) -> None:
    rows = tuple(
        row if row.combination.number == 1 else replace(row, outcome=None) for row in sweep.rows
    )
    ended = replace(sweep, rows=rows)
    ranked = ranking(ended)
    assert [r.rank for r in ranked] == [1, None, None, None]
    assert ended.left == 6
    assert "interrupted with 6 of 8 tasks left" in ranking_markdown(ended, ranked, "mota")


def test_markdown_shows_ranks_failures_and_common_parameters(sweep: Sweep) -> None:
    text = ranking_markdown(sweep, ranking(sweep), "mota")
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert rows[2].startswith("| 1 * | 2 | default | 20.0 | affine | 0.900 | 0.100 |")
    assert rows[5].startswith("| - | 3 | default | 26.0 | rigid | 0.950 |")
    assert "- combination 3 over b: it broke" in text
    assert "Common to all: tracking.gate = 3.0." in text
    assert "4 of 4 combinations over 2 sources" in text


def test_csv_leaves_unknown_values_empty(sweep: Sweep) -> None:
    rows = list(csv.DictReader(io.StringIO(ranking_csv(sweep, ranking(sweep)))))
    assert [row["combination"] for row in rows] == ["2", "1", "4", "3"]
    assert rows[0]["ego_motion.model"] == "affine"
    assert float(rows[1]["mota"]) == pytest.approx(0.6)
    assert (rows[3]["rank"], rows[3]["recall"], rows[0]["speed_rmse_mps"]) == ("", "", "")


def test_parquet_has_a_row_for_every_task(sweep: Sweep, tmp_path: Path) -> None:
    write_parquet(sweep, tmp_path / "results.parquet")
    table = pyarrow.parquet.read_table(tmp_path / "results.parquet")
    assert table.num_rows == 8
    types = {name: str(table.schema.field(name).type) for name in table.schema.names}
    assert types["evidence.radius_px"] == "double"
    assert types["ego_motion.model"] == "string"
    assert (types["truth_count"], types["recall"]) == ("int64", "double")
    rows = table.to_pylist()
    failed = [row for row in rows if row["status"] == "failed"]
    assert [(r["combination"], r["source"], r["error"]) for r in failed] == [(3, "b", "it broke")]
    assert failed[0]["mota"] is None
    assert failed[0]["median_ms"] is None
    assert rows[1]["mota"] == 0.9
    assert [path.name for path in tmp_path.iterdir()] == ["results.parquet"]


def test_figure_shows_points_and_front(sweep: Sweep, tmp_path: Path) -> None:
    figure = sweep_figure(sweep, ranking(sweep), "mota")
    (axes,) = figure.axes
    points, front, default = axes.lines
    assert sorted(np.asarray(points.get_xdata())) == pytest.approx([1.1, 1.5, 3.1])
    assert list(np.asarray(front.get_xdata())) == pytest.approx([1.1, 3.1])
    assert list(np.asarray(front.get_ydata())) == pytest.approx([0.6, 0.9])
    assert list(np.asarray(default.get_xdata())) == [1.0, 1.0]
    save_figure(figure, tmp_path / "sweep.png")
    assert (tmp_path / "sweep.png").read_bytes().startswith(b"\x89PNG")


def test_empty_figure_is_drawn(sweep: Sweep) -> None:
    nothing = replace(sweep, rows=tuple(replace(row, outcome=None) for row in sweep.rows))
    figure = sweep_figure(nothing, ranking(nothing), "recall")
    figure.draw_without_rendering()
