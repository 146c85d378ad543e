"""Damaged scenarios: one within its bounds or a one-sentence error, however the YAML is written."""

from __future__ import annotations

import math

import pytest
from hypothesis import example, given

from observer.errors import InputError, ScenarioError
from observer.simulation.scenarios import (
    Scenario,
    _folder,
    load_scenario,
    scenario_from_text,
    scenario_names,
)

from ...damage import damaged_text, examples, hostile_text, read_or_refused

HEAD = "title: A title\nhelp: A sentence.\ndeclares: ideal\nduration_s: 2\n"
FILES = tuple(
    _folder().joinpath(f"{name}.yaml").read_text(encoding="utf-8")
    for name in ("lab", "crossing", "calibration", "vibrating")
)
# Each of nine lists holds the previous one nine times: a billion words if expanded.
LAUGHS = "".join(
    f"l{k}: &l{k} [{', '.join([f'*l{k - 1}'] * 9)}]\n" if k else 'l0: &l0 ["ha"]\n'
    for k in range(10)
)


def hold(text: str) -> None:
    scenario = read_or_refused(lambda: scenario_from_text(text, "mine"), ScenarioError)
    if scenario is not None:
        assert 0 < scenario.duration_s <= 3600
        assert 1 <= scenario.frame_count <= 3600 * 240
        assert Scenario.model_validate(scenario.model_dump()) == scenario
        assert math.isfinite(scenario.camera.baseline_m)


@examples(48)
@given(damaged_text((*FILES, HEAD), ("based_on: lab\n", "kind: ", "objects: ", "x: ")))
@example(HEAD + LAUGHS)
@example(HEAD + "objects: &a [*a]\n")
@example(HEAD + "objects: " + "[" * 5000)
@example(HEAD + "objects: 2001-99-99\n")
@example(HEAD + "objects: 0b_\n")
@example(HEAD + "frame_rate: " + "9" * 5000 + "\n")
@example(HEAD + 'based_on: "a\\0b"\n')
@example(HEAD + "based_on: " + "a" * 5000 + "\n")
@example(HEAD + "based_on: [lab]\n")
@example(HEAD + "? {a: 1}\n: 2\n")
@example(HEAD + "1: 2\n")
@example(HEAD + '"a\\nb": 2\n')
@example(HEAD + "frame_rate: .nan\n")
@example(HEAD + "frame_rate: 1:30\n")
@example("\x00")
def test_a_damaged_scenario_is_refused_or_valid(text: str) -> None:
    hold(text)


@examples(24)
@given(hostile_text(("title: ", "objects: ", "- ", "based_on: lab\n")))
def test_arbitrary_text_is_refused_or_valid(text: str) -> None:
    hold(text)
    hold(HEAD + text)


@examples(24)
@given(hostile_text(("lab", ".yaml", "/nowhere/")))
@example("a\0.yaml")
@example("a" * 5000 + ".yaml")
def test_an_unknown_scenario_name_is_refused(name: str) -> None:
    if name not in scenario_names():
        with pytest.raises((InputError, OSError)):
            load_scenario(name)
