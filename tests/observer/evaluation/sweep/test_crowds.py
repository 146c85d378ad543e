"""Sweeps over crowds: parameters of guard and planner, judged by how the robot drives."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet
import pytest

from observer.errors import InputError
from observer.evaluation.navigation.contacts import Contacts
from observer.evaluation.navigation.perception_check import PerceptionCheck
from observer.evaluation.navigation.run import IN_TIME, Case, RunResult, free_time_s, run
from observer.evaluation.sweep import crowds
from observer.evaluation.sweep.cluster import ClusterChoice
from observer.evaluation.sweep.crowds import SweepCrowd, driving_figures, sweep_crowd
from observer.evaluation.sweep.figure import sweep_figure
from observer.evaluation.sweep.grid import grid_from_text
from observer.evaluation.sweep.results import Row, Sweep, rankable, ranking
from observer.evaluation.sweep.store import TaskStore
from observer.evaluation.sweep.sweep import Plan, SweepRun
from observer.evaluation.sweep.tables import ranking_csv, ranking_markdown, write_parquet
from observer.evaluation.sweep.task import Outcome
from observer.navigation.parameters import AllParameters

GRID = grid_from_text(
    "set: {guard.speed_max_mps: 1}\nnavigation.berth_m: [0.1, 0.2, 0.4]", "grid.yaml", driving=True
)
CROWD = SweepCrowd("crowd:hard:0.1", 0.1, False, 2)
# Combination number -> (time ratio, contacts per metre).
DRIVEN = {1: (1.5, 0.02), 2: (1.2, 0.02), 3: (2.0, 0.0)}


@pytest.fixture
def sweep() -> Sweep:
    combinations = GRID.chosen()
    rows = []
    for each in combinations:
        time_ratio, contacts = DRIVEN[each.number]
        figures = {"time_ratio": time_ratio, "contacts_per_m": contacts}
        figures |= {"ahead_per_m": contacts / 2, "reached": 1.0}
        rows.append(Row(each, CROWD, Outcome(figures=figures, cpu_s=9.0, wall_s=9.5)))
    return Sweep(GRID, (CROWD,), combinations, tuple(rows), 0.5, "1", 0)


def test_crowd_grid_varies_guard_and_planner() -> None:
    (first, *_) = GRID.chosen()
    changes = {"guard.speed_max_mps": 1.0, "navigation.berth_m": 0.1}
    assert first.parameters == AllParameters().changed(changes)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("navigation.berth_m: [0.1, 9]", "from 0 to 2 m (given: navigation.berth_m 9.0)"),
        ("navigation.berht_m: [0.1]", "did you mean navigation.berth_m?"),
        ("evidence.radius_px: [20]", "has no effect here: only those of guard and navigation"),
        ("set: {dense.rate_hz: 5}", "has no effect here"),
        ("preset: [paper]", "a preset has no effect on driving"),
    ],
)
def test_parameters_without_effect_are_refused(text: str, part: str) -> None:
    with pytest.raises(InputError) as refused:
        grid_from_text(text, "grid.yaml", driving=True)
    assert str(refused.value).startswith("grid.yaml")
    assert part in str(refused.value)


def test_other_sweeps_have_no_driving_parameters() -> None:
    with pytest.raises(InputError, match="no such parameter"):
        grid_from_text("navigation.berth_m: [0.1]", "grid.yaml")


def test_crowd_spec_is_parsed_strictly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(crowds, "crowd_missing", lambda: None)
    kind = sweep_crowd("crowd:kind:0.05", 3)
    assert (kind.density_per_m2, kind.kind, kind.runs) == (0.05, True, 3)
    assert kind.digest == sweep_crowd("crowd:kind:.050").digest
    assert kind.digest != sweep_crowd("crowd:hard:0.05").digest
    for spec in ("crowd:", "crowd:soft:0.1", "crowd:hard:many", "crowd:hard:2", "crowd:hard:-0.1"):
        with pytest.raises(InputError, match="is not a crowd; give crowd:hard:DENSITY"):
            sweep_crowd(spec)
    # Later seeds are reserved for the benchmark.
    with pytest.raises(InputError, match="at most 900 runs"):
        sweep_crowd("crowd:hard:0.1", 901)
    monkeypatch.setattr(crowds, "crowd_missing", lambda: "a crowd needs the package jupedsim")
    with pytest.raises(InputError, match="jupedsim"):
        sweep_crowd("crowd:hard:0.1")


def test_ranking_trades_time_against_contacts(sweep: Sweep) -> None:
    ranked = ranking(sweep, "time_ratio")
    assert [(r.combination.number, r.best) for r in ranked] == [(2, True), (1, False), (3, True)]
    ranked = ranking(sweep, "contacts_per_m")
    assert [(r.combination.number, r.best) for r in ranked] == [(3, True), (2, True), (1, False)]


def test_sweeps_are_ranked_only_by_measured_figures() -> None:
    assert rankable(None, driving=True) == "time_ratio"
    assert rankable(None, driving=False) == "mota"
    assert rankable("reached", driving=True) == "reached"
    with pytest.raises(InputError, match="mota is not measured over crowds; rank by time_ratio,"):
        rankable("mota", driving=True)
    with pytest.raises(InputError, match="reached is not measured over sources"):
        rankable("reached", driving=False)


def test_tables_and_figure_show_driving_results(sweep: Sweep, tmp_path: Path) -> None:
    ranked = ranking(sweep, "time_ratio")
    text = ranking_markdown(sweep, ranked, "time_ratio")
    assert "crowd:hard:0.1 (2 runs)" in text
    assert "| 1 * | 2 | default | 0.2 | 1.200 | 0.020 | 0.010 | 1.000 | 1 |" in text
    assert "matched within" not in text
    assert "cost / default" not in text
    first, *_ = csv.DictReader(io.StringIO(ranking_csv(sweep, ranked)))
    assert (first["time_ratio"], first["navigation.berth_m"]) == ("1.2", "0.2")
    write_parquet(sweep, tmp_path / "results.parquet")
    table = pyarrow.parquet.read_table(tmp_path / "results.parquet")
    assert table.to_pylist()[2] == {
        "combination": 3, "runs_planned": 2, "preset": "default", "source": "crowd:hard:0.1",
        "status": "finished", "error": None, "version": "1", "navigation.berth_m": 0.4,
        "time_ratio": 2.0, "contacts_per_m": 0.0, "ahead_per_m": 0.0, "reached": 1.0,
        "cpu_s": 9.0, "wall_s": 9.5,
    }  # fmt: skip
    (axes,) = sweep_figure(sweep, ranked, "time_ratio").axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == (
        "contacts / m",
        "time ratio (lower is better)",
    )


def test_a_robot_that_never_arrives_has_no_time_ratio(monkeypatch: pytest.MonkeyPatch) -> None:
    def drive(case: Case, parameters: AllParameters) -> RunResult:
        """Arrive late at 1.4 m/s, never at 2 m/s, and at 0.5 m/s every other time."""
        free_s, speed = free_time_s(parameters.guard), parameters.guard.speed_max_mps
        reached = speed == 1.4 or (speed == 0.5 and case.seed % 2 == 0)
        nothing = PerceptionCheck(0, 0, 0, 0, 0, 0, (), 0)
        time_s = (IN_TIME - 0.1 if reached else IN_TIME) * free_s
        return RunResult(
            case, reached, time_s, free_s, 10.0, Contacts(moving=1), {}, 0.0, 0.0, nothing
        )

    monkeypatch.setattr(crowds, "run", drive)
    grid = grid_from_text("guard.speed_max_mps: [0.5, 1.4, 2.0]", "grid.yaml", driving=True)
    rows = []
    for each in grid.chosen():
        assert isinstance(each.parameters, AllParameters)
        figures = driving_figures(CROWD, each.parameters)
        rows.append(Row(each, CROWD, Outcome(figures=figures, cpu_s=9.0, wall_s=9.5)))
    assert [row.figures["reached"] for row in rows] == [0.5, 1.0, 0.0]
    sweep = Sweep(grid, (CROWD,), grid.chosen(), tuple(rows), 0.5, "1", 0)
    ranked = ranking(sweep, "time_ratio")
    assert [(r.combination.number, r.rank) for r in ranked] == [(2, 1), (1, None), (3, None)]
    # Over a second crowd, where it arrives, it does not become cheap either.
    other = replace(CROWD, name="crowd:hard:0.05", density_per_m2=0.05)
    figures = {"time_ratio": 1.0, "contacts_per_m": 0.1, "ahead_per_m": 0.0, "reached": 1.0}
    rows += [Row(each, other, Outcome(figures=figures)) for each in grid.chosen()]
    both = Sweep(grid, (CROWD, other), grid.chosen(), tuple(rows), 0.5, "1", 0)
    costs = {r.combination.number: r.cost for r in ranking(both, "contacts_per_m")}
    assert costs[2] is not None
    assert (costs[1], costs[3]) == (None, None)


def test_figures_match_the_benchmark() -> None:
    pytest.importorskip("jupedsim", reason="needs the extra crowd, which brings jupedsim")
    parameters = AllParameters()
    runs = [run(Case("planner", 0.02, False, 1e-3, seed), parameters) for seed in (1, 2, 3)]
    figures = driving_figures(SweepCrowd("crowd:hard:0.02", 0.02, False, 3), parameters)
    driven_m = sum(each.driven_m for each in runs)
    times = sorted(each.time_s for each in runs)
    assert figures == {
        "time_ratio": times[1] / free_time_s(parameters.guard),
        "contacts_per_m": sum(each.contacts.moving for each in runs) / driven_m,
        "ahead_per_m": sum(each.contacts.ahead for each in runs) / driven_m,
        "reached": 1.0,
    }


def test_crowd_sweep_is_stored_and_resumed(tmp_path: Path) -> None:
    pytest.importorskip("jupedsim", reason="needs the extra crowd, which brings jupedsim")
    grid = grid_from_text("guard.speed_max_mps: [0.5, 1.0]", "grid.yaml", driving=True)
    plan = Plan(grid, grid.chosen(), (sweep_crowd("crowd:hard:0.01", 3),), 0.5)
    made = SweepRun(plan, TaskStore(tmp_path))
    made.run(ClusterChoice(processes=False))
    assert not made.result.failed
    slow, fast = (row.figures["time_ratio"] for row in made.result.rows)
    assert slow is not None
    assert fast is not None
    # Both use the same clock. In a single run, chance encounters matter more than anything else.
    assert fast < 0.8 * slow
    again = SweepRun(plan, TaskStore(tmp_path))
    assert again.kept == 2
    assert [row.figures for row in again.result.rows] == [r.figures for r in made.result.rows]
