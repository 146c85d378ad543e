"""Parameters of the planner: their former constants as defaults, bounds, and that each acts."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from observer.errors import ParameterError
from observer.guard.parameters import GuardParameters
from observer.guard.sight import FreeScan, SeenObstacle, Sight
from observer.navigation.errand import Errand, Goal
from observer.navigation.navigator import Navigator
from observer.navigation.parameters import AllParameters, NavigationParameters
from observer.navigation.plan import Plan
from observer.types import Status

PLANNER = NavigationParameters()
BEARINGS = tuple(np.radians(np.arange(-30.0, 30.1, 3.0)).tolist())
FREE = FreeScan(BEARINGS, (None,) * 21, (0.3,) * 21, (5.0,) * 21)
SIGHT = Sight(1, 10.0, 10.02, "real", Status.OK, (), True, (), FREE)
ERRAND = Errand(Goal(1, 5.0, 0.0, 1e-3), 10.0, 0.0, 0.0, 0.0, 0.3, 0.0, 0.26, 0.38, 0.44)
# Crossing from the left or standing beside the path, each group a little farther away.
PEOPLE = [
    SeenObstacle(3, 0.8 + 0.3 * k, y, 0.0, vy, 0.3, 0.05, 0.1, False)
    for k in range(6)
    for y, vy in ((1.2, -0.5), (0.7, 0.0), (1.0, 0.0))
]


def second_plan(planner: NavigationParameters, seen: SeenObstacle, at: Errand) -> Plan:
    """Plan twice, the second time with these parameters and the obstacle out of view."""
    navigator = Navigator(GuardParameters(), PLANNER)
    navigator.see(replace(SIGHT, obstacles=(seen,)), np.array([at.x, at.y, at.yaw]))
    navigator.plan(at, 10.05)
    navigator.use(GuardParameters(), planner)
    navigator.see(replace(SIGHT, received=10.5), np.array([at.x, at.y, at.yaw]))
    return navigator.plan(replace(at, time=10.5), 10.55)


def test_the_default_prior_is_unchanged() -> None:
    assert PLANNER.prior == (0.82, 0.08, 0.05, 0.05)


def test_going_straight_on_always_has_some_probability() -> None:
    names = ("navigation.stop_probability", "navigation.turn_probability")
    most = AllParameters().changed(
        {name: AllParameters.declaration(name)["maximum"] for name in names}
    )
    assert most.navigation.prior[0] == pytest.approx(0.05)
    assert math.fsum(most.navigation.prior) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        ("stop_probability", 0.6, "must be a finite number from 0 to 0.5"),
        ("turn_probability", -0.1, "must be a finite number from 0 to 0.45"),
        ("risk_per_metre", 0.0, "must be a finite number from 1e-06 to 1 1/m"),
        ("berth_m", "wide", "must be a finite number from 0 to 2 m"),
        ("berht_m", 0.3, "there is no such parameter; did you mean navigation.berth_m?"),
    ],
)
def test_a_refused_value_is_explained(name: str, value: object, sentence: str) -> None:
    with pytest.raises(ParameterError) as refused:
        AllParameters().changed({f"navigation.{name}": value})
    assert refused.value.problems == {f"navigation.{name}": sentence}


def test_a_change_does_not_affect_vision_and_guard() -> None:
    before = AllParameters()
    after = before.changed({"navigation.berth_m": 0.3})
    assert (after.vision, after.guard) == (before.vision, before.guard)
    assert before.difference(after) == {"navigation.berth_m": 0.3}


@pytest.mark.parametrize(
    "changes",
    [
        {"detour_m": 0.0},
        {"berth_m": 1.0},
        {"near_m": 0.0},
        {"near_cost_mps": 5.0},
        {"foresight_s": 0.2},
        {"refused_m": 10.0},
        {"memory_s": 0.1},
        {"acceleration_noise": 3.0},
        {"stop_probability": 0.5},
        {"turn_probability": 0.45},
    ],
)
def test_a_change_applies_to_the_next_plan(changes: dict[str, float]) -> None:
    changed = PLANNER.model_copy(update=changes)
    assert any(
        second_plan(changed, seen, ERRAND) != second_plan(PLANNER, seen, ERRAND) for seen in PEOPLE
    )
