"""The engine's plans: one for each frame while the observer drives to a goal."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest

from app.engine.wayfinding import Wayfinder
from app.engine.wheel_feed import WheelFeed
from app.runtime.latest import LatestReader, LatestWriter, create_slot
from observer.guard.sight import FreeScan, SeenObstacle, Sight
from observer.navigation.errand import Errand, Goal
from observer.navigation.navigator import Navigator
from observer.navigation.parameters import AllParameters
from observer.navigation.plan import Plan, plan_of
from observer.occupancy import FREE as FREE_CELL
from observer.occupancy import OccupancyMap
from observer.types import Status

NOW = 100.0
PARAMETERS = AllParameters()
FREE = FreeScan((-0.5, 0.0, 0.5), (None,) * 3, (0.3,) * 3, (5.0,) * 3)
SIGHT = Sight(7, NOW - 0.1, NOW - 0.02, "real", Status.OK, (), True, (), FREE)
ERRAND = Errand(Goal(3, 3.0, 0.0, 1e-3), NOW - 0.02, 0.0, 0.0, 0.0, 0.0, 0.0, 0.26, 0.38, 0.44)
STANDING = [[NOW - 0.1 * k, 0.0, 0.0, 0.0] for k in range(9, -1, -1)]


class Link:
    """Both slots, and a wayfinder between them, at a fixed time."""

    def __init__(self) -> None:
        fds = [create_slot(1 << 16) for _ in range(2)]
        self.wheels = LatestWriter(fds[0])
        self.plans = LatestReader(fds[1])
        self._ends = (LatestReader(fds[0]), LatestWriter(fds[1]))
        for fd in fds:
            os.close(fd)
        self.wayfinder = Wayfinder(self._ends[1], WheelFeed(self._ends[0]), lambda: NOW)
        self.local_map: OccupancyMap | None = None

    def look(
        self,
        sight: Sight = SIGHT,
        errand: Errand | None = ERRAND,
        parameters: AllParameters = PARAMETERS,
    ) -> Plan | None:
        facts = {} if errand is None else {"errand": errand.facts()}
        self.wheels.write({"observer": STANDING, **facts})
        before = self.plans.read()
        self.local_map = self.wayfinder.plan(sight, parameters)
        value = self.plans.read(0 if before is None else before.sequence)
        return None if value is None else plan_of(value.header)

    def close(self) -> None:
        for end in (self.wheels, self.plans, *self._ends):
            end.close()


@pytest.fixture
def link() -> Iterator[Link]:
    made = Link()
    yield made
    made.close()


def test_no_plan_is_made_without_an_errand(link: Link) -> None:
    assert link.look(errand=None) is None


def test_a_plan_leads_to_the_goal(link: Link) -> None:
    plan = link.look()
    assert plan is not None
    assert (plan.goal, plan.received) == (3, SIGHT.received)
    assert plan.speed_mps == pytest.approx(PARAMETERS.guard.speed_max_mps)
    assert plan.turn_rate_radps == pytest.approx(0.0, abs=0.01)
    assert plan.path[-1][0] > 1.0
    assert plan.reason == "Driving to the goal, 3.0 m away."


def test_the_next_plan_uses_changed_planner_parameters(link: Link) -> None:
    crossing = SeenObstacle(3, 1.4, 1.2, 0.0, -0.5, 0.3, 0.05, 0.1, False)
    sight = replace(SIGHT, obstacles=(crossing,))
    careful = PARAMETERS.changed({"navigation.detour_m": 20.0})
    plans = [link.look(sight, parameters=each) for each in (PARAMETERS, careful, PARAMETERS)]
    assert [None if plan is None else plan.speed_mps for plan in plans] == [0.5, 0.0, 0.5]


def test_a_frame_without_odometry_gives_no_plan(link: Link) -> None:
    assert link.look(replace(SIGHT, received=NOW - 5.0)) is None


def test_a_failing_planner_gives_no_plan_and_is_logged_once(
    link: Link, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(*_: object) -> Plan:
        raise ZeroDivisionError

    monkeypatch.setattr(Navigator, "plan", fail)
    assert link.look() is None
    assert link.look() is None
    assert caplog.text.count("planning the way to the goal failed") == 1
    monkeypatch.undo()
    assert link.look() is not None


@pytest.mark.parametrize("changed", [{"risk_per_metre": math.nan}, {"reason": "x" * (1 << 17)}])
def test_a_plan_that_cannot_be_sent_leaves_the_source_open(
    link: Link, monkeypatch: pytest.MonkeyPatch, changed: dict[str, Any]
) -> None:
    """Whatever this raised would end the session of the cameras."""
    made = Navigator.plan
    monkeypatch.setattr(Navigator, "plan", lambda *args: replace(made(*args), **changed))
    assert link.look() is None
    monkeypatch.undo()
    assert link.look() is not None


def test_a_local_map_is_made_twice_a_second_while_driving_to_a_goal(link: Link) -> None:
    received = [NOW - 0.9 + 0.1 * k for k in range(10)]
    maps = []
    for each in received:
        link.look(replace(SIGHT, received=each))
        maps.append(link.local_map)
    assert [k for k, made in enumerate(maps) if made is not None] == [0, 5]
    made = maps[5]
    assert made is not None
    assert made.received == received[5]
    assert made.robot == (0.0, 0.0, 0.0)
    assert (made.cells() == FREE_CELL).any()
    link.look(errand=None)
    assert link.local_map is None


def test_a_degraded_frame_gives_no_local_map(link: Link) -> None:
    link.look(replace(SIGHT, status=Status.DEGRADED))
    assert link.local_map is None
    link.look()
    assert link.local_map is not None
