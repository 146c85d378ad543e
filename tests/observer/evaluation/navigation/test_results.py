"""Sums, table and figure of the navigation benchmark, from made-up runs."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from observer.errors import InputError
from observer.evaluation.figure import save_figure
from observer.evaluation.navigation import benchmark
from observer.evaluation.navigation.benchmark import Choice, measure
from observer.evaluation.navigation.contacts import Contacts
from observer.evaluation.navigation.coverage import Walk, WalkResult
from observer.evaluation.navigation.figure import navigation_figure
from observer.evaluation.navigation.oracle import Answer, Question
from observer.evaluation.navigation.perception_check import PerceptionCheck
from observer.evaluation.navigation.results import (
    NavigationBenchmark,
    coverages,
    rate,
    summarize,
)
from observer.evaluation.navigation.run import Case, RunResult
from observer.evaluation.navigation.tables import navigation_markdown

FAST = RunResult(
    Case("planner", 0.1, False, 1e-3, 1000), True, 30.0, 20.0, 10.0,
    Contacts(moving=3, ahead=2, avoidable=1, standing=5, standing_seen=4),
    {"sonar detects something approaching": 3}, 5.0, 2.0,
    PerceptionCheck(100, 90, 40, 36, 1, 2, (0.1, -0.3, 0.0, 0.1), 3),
)  # fmt: skip
SLOW = dataclasses.replace(FAST, reached=False, time_s=60.0, contacts=Contacts(standing=1))
BESIDE = dataclasses.replace(
    FAST, case=Case("guard", 0.1, False, 1e-3, 1000), stops={"an obstruction": 1}
)
ANSWER = Answer(Question(0.1, 1000), 24.0)
WALK = WalkResult(Walk(0.1, 1000), ((0.1, 0.5, 0.96, 0.2), ()), ((0.3, 0.99), (0.5,)))


def result(*runs: RunResult) -> NavigationBenchmark:
    return NavigationBenchmark(1000, summarize(runs, [ANSWER]), coverages([WALK]))


def test_runs_of_a_setting_are_summarized() -> None:
    planner, guard = summarize([FAST, SLOW, BESIDE, FAST], [ANSWER])
    assert (planner.runs, planner.reached) == (3, 2)
    assert planner.contacts == Contacts(6, 4, 2, 11, 8)
    assert planner.contacts_per_m == pytest.approx(6 / 30)
    assert planner.time_ratio == pytest.approx(1.5)
    assert planner.oracle_ratio == pytest.approx(1.25)
    assert planner.stops == {"sonar detects something approaching": 9}
    assert planner.setting.risk_per_metre == 1e-3
    assert guard.setting.risk_per_metre is None
    assert planner.ahead_per_m == pytest.approx(rate(4, 30.0))


def test_goal_reached_by_few_runs_has_no_time_ratio() -> None:
    (one,) = summarize([FAST, SLOW], [ANSWER])
    assert one.time_ratio is None
    assert "> 3" in navigation_markdown(result(FAST, SLOW))


def test_kind_people_have_no_oracle_ratio() -> None:
    kind = dataclasses.replace(FAST, case=dataclasses.replace(FAST.case, kind=True))
    (one,) = summarize([kind], [ANSWER])
    assert one.oracle_ratio is None
    assert "| 1.50 | – |" in navigation_markdown(result(kind))


def test_goal_unreachable_for_the_oracle_does_not_count_against_the_driver() -> None:
    blocked = dataclasses.replace(SLOW, case=dataclasses.replace(SLOW.case, seed=1001))
    (one,) = summarize([FAST, blocked], [ANSWER, Answer(Question(0.1, 1001), None)])
    assert one.oracle_ratio == pytest.approx(1.25)
    assert one.time_ratio is None


def test_rates_have_exact_poisson_intervals() -> None:
    assert rate(0, 100.0) == pytest.approx((0.0, 0.0, 0.03689), abs=1e-5)
    # Garwood's table: 3 events, 0.619 to 8.767.
    assert rate(3, 1.0) == pytest.approx((3.0, 0.6187, 8.7673), abs=1e-4)


def test_coverage_is_given_by_time_and_unknown_without_predictions() -> None:
    in_view, out_of_view = coverages([WALK])[:2], coverages([WALK])[2:]
    assert [(each.ahead_s, each.predictions, each.share) for each in in_view] == [
        (1.0, 4, 0.75),
        (2.0, 0, None),
    ]
    assert [(each.ahead_s, each.predictions, each.share) for each in out_of_view] == [
        (1.0, 2, 0.5),
        (2.0, 1, 1.0),
    ]


def test_table_shows_both_drivers_and_every_reason() -> None:
    text = navigation_markdown(result(FAST, SLOW, BESIDE))
    assert "| planner | model | hard | 0.1 | 0.001 | 2 | 50 % |" in text
    assert "| guard | model | hard | 0.1 | – | 1 | 100 % | 1.50 | 1.25 |" in text
    # Both runs of the planner: moving, driven into, avoidable, standing and seen before.
    assert "| 3 (0.1500 / m) | 2 (0.1000 / m, 0.0121 to 0.3612) | 1 | 6 | 4 |" in text
    assert "| sonar detects something approaching | 6 | 0 |" in text
    assert "| an obstruction | 0 | 1 |" in text
    assert "| in view | 1 s | 4 | 75 % |" in text
    assert "| out of view | 2 s | 1 | 100 % |" in text
    assert (
        "| planner | model | hard | 0.1 | 200 | 90 % | 90 % | 1.0 | 2.0 | 0.10 | 0.17 | 75 % |"
        in text
    )
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert all(line.count("|") == 18 for line in rows[:4])
    json.dumps(result(FAST, BESIDE).as_dict(), allow_nan=False)


@pytest.mark.parametrize("runs", [[FAST, BESIDE], [SLOW], [BESIDE]])
def test_figure_is_drawn_for_any_number_of_contacts(runs: list[RunResult], tmp_path: Path) -> None:
    path = tmp_path / "figure.svg"
    save_figure(navigation_figure(result(*runs)), path)
    assert path.stat().st_size > 5000


def test_guard_runs_once_for_all_risks() -> None:
    choice = Choice(3, (0.1, 0.2), (False, True), (1e-3, 1e-2), 1000)
    cases = choice.cases()
    assert len(cases) == len(set(cases)) == 3 * 2 * 2 * (2 + 1)
    assert {case.seed for case in cases} == {1000, 1001, 1002}
    assert len(choice.walks()) == 6


def test_missing_jupedsim_is_refused_naming_the_package(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(benchmark, "crowd_missing", lambda: "a crowd needs the package jupedsim")
    with pytest.raises(InputError, match="needs the package jupedsim"):
        measure(Choice(1, (0.1,), (True,), (1e-3,), 1000), 1, lambda *_: None)


def test_several_processes_give_the_same_result_as_one() -> None:
    pytest.importorskip("jupedsim", reason="needs the extra crowd, which brings jupedsim")
    choice = Choice(1, (0.02,), (False,), (1e-3,), 7)
    seen: list[tuple[int, int | None]] = []
    alone = measure(choice, 1, lambda done, total: seen.append((done, total)))
    # Both drivers, the walk and the oracle make four steps.
    assert seen == [(k, 4) for k in range(5)]
    assert measure(choice, 2, lambda *_: None) == alone
