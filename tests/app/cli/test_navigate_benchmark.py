"""``navigate-benchmark``: table, JSON and figure, and what it refuses before any work."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from observer.evaluation.navigation import benchmark

from .shell import Shell

CALL = ("navigate-benchmark", "--runs", "1", "--density", "0.02", "--hard", "--jobs", "1")


def test_it_prints_both_drivers_and_draws_a_figure(shell: Shell, tmp_path: Path) -> None:
    pytest.importorskip("jupedsim", reason="needs the extra crowd, which brings jupedsim")
    figure = tmp_path / "risk.png"
    done = shell(*CALL, "--seed", "7", "--risk", "0.01", "--figure", str(figure))
    assert done.code == 0, done.err
    assert "| planner | hard | 0.02 | 0.01 | 1 |" in done.out
    assert "| guard | hard | 0.02 | – | 1 |" in done.out
    assert "within the 95 % region" in done.out
    assert figure.stat().st_size > 5000
    again = shell(*CALL, "--seed", "7", "--risk", "0.01", "--json")
    values = json.loads(again.out)
    assert values["first_seed"] == 7
    assert [each["setting"]["driver"] for each in values["summaries"]] == ["planner", "guard"]


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (("--figure", "risk.txt"), "must end in .png, .svg, .pdf"),
        (("--figure", "/nowhere/risk.png"), "the folder /nowhere does not exist"),
        (("--density", "-1"), "density"),
        (("--risk", "0"), "risk"),
        (("--runs", "0"), "runs"),
    ],
)
def test_what_is_wrong_is_said_before_the_work(
    shell: Shell, arguments: tuple[str, ...], part: str
) -> None:
    done = shell("navigate-benchmark", *arguments)
    assert (done.code, done.out) == (2, "")
    assert len(done.err.strip().splitlines()) == 1, done.err
    assert part in done.err


def test_without_the_extra_one_sentence_names_it(
    shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        benchmark,
        "crowd_missing",
        lambda: 'install it with: pip install "dynamic-observer[crowd]"',
    )
    done = shell(*CALL)
    assert (done.code, done.out) == (2, "")
    assert "dynamic-observer[crowd]" in done.err
    assert len(done.err.strip().splitlines()) == 1, done.err
