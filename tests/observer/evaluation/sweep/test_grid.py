"""Grids of parameters: parsed strictly, counted before they are built, sampled at random."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.errors import InputError
from observer.evaluation.sweep.grid import Grid, grid_from_text, read_grid
from observer.parameters import preset

TEXT = """
preset: [default, paper]
set:
  tracking.gate: 3
klt_tracking.spacing_px: [16, 20]
evidence.false_alarms_per_frame: [1e-3, 0.01, 1]
ego_motion.model: [rigid, affine]
"""


def test_grid_combines_every_value_with_every_other() -> None:
    grid = grid_from_text(TEXT, "grid.yaml")
    assert grid.count == 2 * 2 * 3 * 2
    combinations = grid.chosen()
    assert [c.number for c in combinations] == list(range(1, 25))
    assert len({(c.preset, *c.values.values()) for c in combinations}) == 24
    second, last = combinations[1], combinations[-1]
    assert second.preset == "default"
    assert list(second.values.items()) == [
        ("klt_tracking.spacing_px", 16),
        ("evidence.false_alarms_per_frame", 0.001),
        ("ego_motion.model", "affine"),
    ]
    expected = {"tracking.gate": 3.0, **last.values}
    assert last.parameters == preset("paper").changed(expected)
    assert last.parameters.evidence.false_alarms_per_frame == 1.0


def test_default_preset_is_used_when_none_is_given() -> None:
    (only,) = grid_from_text("evidence.radius_px: [30]", "grid.yaml").chosen()
    assert only.parameters == preset("default").changed({"evidence.radius_px": 30.0})
    (paper,) = grid_from_text("preset: paper", "grid.yaml").chosen()
    assert paper.parameters == preset("paper")


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "must be YAML"),
        ("radius", "must be YAML"),
        ("evidence.radius: [20]", "did you mean evidence.radius_px?"),
        ("evidence.radius_px: [20, 900]", "from 4 to 200 px (given: evidence.radius_px 900.0)"),
        ("evidence.radius_px: [20, wide]", "given: evidence.radius_px wide"),
        ("evidence.radius_px: 20", "must have a list of values"),
        ("evidence.radius_px: []", "must have a list of values"),
        ("evidence.radius_px: [[20], 30]", "plain number or word"),
        ("evidence.radius_px: [20, 20.0]", "lists 20.0 twice"),
        ("evidence.radius_px: [20]\nevidence.radius_px: [30]", "appears twice"),
        ("evidence.radius_px: [nan]", "finite number"),
        ("klt_tracking.spacing_px: [16.5]", "whole number"),
        ("flow.match_brightness: [yes]", "true or false"),
        ("ego_motion.model: [rigid, planar]", "one of"),
        ("preset: [best]", "paper, default"),
        ("preset: []", "at least one of"),
        ("preset: [paper, paper]", "twice"),
        ("set: [1]", "one value each"),
        ("set: {evidence.radius_px: 20}\nevidence.radius_px: [20, 30]", "both fixed and varied"),
        ("set: {evidence.radius_px: 2}", "from 4 to 200 px"),
        ("evidence.radius_px: [20", "truncated or not valid YAML"),
    ],
)
def test_invalid_grid_is_refused_with_a_one_line_reason(text: str, part: str) -> None:
    with pytest.raises(InputError) as refused:
        grid_from_text(text, "grid.yaml")
    assert str(refused.value).startswith("grid.yaml")
    assert part in str(refused.value)
    assert "\n" not in str(refused.value)


def test_missing_grid_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.yaml cannot be read.*a grid of parameters"):
        read_grid(tmp_path / "none.yaml")


def huge() -> Grid:
    fitting = {
        "evidence.memory_s": [round(0.1 + 0.05 * i, 2) for i in range(100)],
        "klt_tracking.max_error": [1.0 + i / 2 for i in range(100)],
        "evidence.radius_px": [10.0 + i for i in range(100)],
        "klt_tracking.scale_change_noise": [i / 100 for i in range(100)],
        "evidence.noise_correlation": [i / 100 for i in range(100)],
    }
    return grid_from_text("\n".join(f"{n}: {v}" for n, v in fitting.items()), "huge.yaml")


def test_huge_grid_is_sampled_without_building_it() -> None:
    grid = huge()
    assert grid.count == 100**5
    drawn = grid.chosen(drawn=20, seed=4)
    numbers = [c.number for c in drawn]
    assert numbers == sorted(set(numbers))
    assert len(numbers) == 20
    assert numbers == [c.number for c in grid.chosen(drawn=20, seed=4)]
    assert numbers != [c.number for c in grid.chosen(drawn=20, seed=5)]
    assert [c.number for c in grid.chosen(limit=3)] == [1, 2, 3]
    with pytest.raises(InputError, match="not both"):
        grid.chosen(limit=1, drawn=1)


def test_oversized_sample_returns_the_whole_grid() -> None:
    grid = grid_from_text(TEXT, "grid.yaml")
    assert grid.chosen(drawn=1000) == grid.chosen(limit=1000) == grid.chosen()


@given(st.lists(st.integers(1, 4), min_size=1, max_size=4), st.data())
def test_number_identifies_exactly_one_combination(sizes: list[int], data: st.DataObject) -> None:
    names = ("evidence.radius_px", "evidence.memory_s", "tracking.gate", "klt_tracking.max_error")
    lists = {n: tuple(1.0 * k + 4 for k in range(s)) for n, s in zip(names, sizes, strict=False)}
    grid = Grid(("default",), {}, lists)
    one = data.draw(st.integers(1, grid.count))
    other = data.draw(st.integers(1, grid.count))
    same = grid.combination(one).values == grid.combination(other).values
    assert same == (one == other)
