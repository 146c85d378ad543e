"""``navigate-benchmark``: table, JSON and figure, and what it refuses before any work."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from observer.evaluation.navigation import benchmark

from .shell import Shell

CALL = ("navigate-benchmark", "--runs", "1", "--density", "0.02", "--hard", "--jobs", "1")


def test_both_drivers_are_printed_and_a_figure_is_drawn(shell: Shell, tmp_path: Path) -> None:
    pytest.importorskip("jupedsim", reason="needs the extra crowd, which brings jupedsim")
    figure = tmp_path / "risk.png"
    done = shell(*CALL, "--seed", "7", "--risk", "0.01", "--figure", str(figure))
    assert done.code == 0, done.err
    assert "| planner | model | hard | 0.02 | 0.01 | 1 |" in done.out
    assert "| guard | model | hard | 0.02 | – | 1 |" in done.out
    assert "within the 95 % region" in done.out
    assert figure.stat().st_size > 5000
    again = shell(*CALL, "--seed", "7", "--risk", "0.01", "--json")
    values = json.loads(again.out)
    assert values["first_seed"] == 7
    assert [each["setting"]["driver"] for each in values["summaries"]] == ["planner", "guard"]


def test_parameters_of_planner_and_guard_can_be_set(shell: Shell) -> None:
    pytest.importorskip("jupedsim", reason="needs the extra crowd, which brings jupedsim")
    # Half the speed takes twice the time, apart from the acceleration phase.
    slow = ("--set", "guard.speed_max_mps=0.25", "--set", "navigation.risk_per_metre=0.02")
    done = shell(*CALL, "--seed", "7", "--json", *slow)
    assert done.code == 0, done.err
    values = json.loads(done.out)
    assert values["changed"] == {"guard.speed_max_mps": 0.25, "navigation.risk_per_metre": 0.02}
    planner, _ = values["summaries"]
    assert planner["setting"]["risk_per_metre"] == 0.02
    assert planner["total_s"] > 9.75 / 0.25
    table = shell(*CALL, "--seed", "7", *slow)
    assert "Not at their defaults: guard.speed_max_mps = 0.25, navigation.risk" in table.out


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (("--figure", "risk.txt"), "must end in .png, .svg, .pdf"),
        (("--figure", "/nowhere/risk.png"), "the folder /nowhere does not exist"),
        (("--density", "-1"), "density"),
        (("--risk", "0"), "risk"),
        (("--runs", "0"), "runs"),
        (("--set", "navigation.berth_m=9"), "must be a finite number from 0 to 2 m"),
        (("--set", "navigation.berth_m"), "--set takes NAME=VALUE"),
        (("--set", "dense.rate_hz=5"), "has no effect here: only those of guard"),
        (("--set", "navigation.berht_m=1"), "did you mean navigation.berth_m?"),
    ],
)
def test_invalid_arguments_are_reported_before_the_work(
    shell: Shell, arguments: tuple[str, ...], part: str
) -> None:
    done = shell("navigate-benchmark", *arguments)
    assert (done.code, done.out) == (2, "")
    assert len(done.err.strip().splitlines()) == 1, done.err
    assert part in done.err


def test_a_missing_extra_gives_a_one_line_error_naming_it(
    shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        benchmark,
        "crowd_missing",
        lambda: "install it with: pip install 'dynamic-observer[crowd]'",
    )
    done = shell(*CALL)
    assert (done.code, done.out) == (2, "")
    assert "dynamic-observer[crowd]" in done.err
    assert len(done.err.strip().splitlines()) == 1, done.err
