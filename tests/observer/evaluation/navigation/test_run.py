"""Runs through crowds: equal seeds give equal runs; an empty room takes the free time."""

from __future__ import annotations

import math

import numpy as np
import pytest

from observer.evaluation.navigation.contacts import Contacts
from observer.evaluation.navigation.coverage import AHEAD_S, Walk, follow
from observer.evaluation.navigation.crowd import People
from observer.evaluation.navigation.robot import SPEC, Robot
from observer.evaluation.navigation.run import (
    DRIVERS,
    GOAL,
    Case,
    Driver,
    Moment,
    free_time_s,
    general,
    run,
)
from observer.navigation.parameters import AllParameters

pytest.importorskip("jupedsim", reason="needs the extra crowd, which brings jupedsim")

PARAMETERS = AllParameters()
LIMITS = PARAMETERS.guard


@pytest.mark.parametrize("driver", DRIVERS)
def test_empty_room_takes_about_the_free_time(driver: Driver) -> None:
    moments: list[Moment] = []
    result = run(Case(driver, 0.0, False, 1e-3, 1), PARAMETERS, moments.append)
    assert result.reached
    assert result.time_s < 1.2 * free_time_s(LIMITS)
    assert result.driven_m == pytest.approx(9.75, abs=0.2)
    assert (result.contacts, result.stops) == (Contacts(), {})
    assert math.dist(moments[-1].pose[:2], GOAL) < 0.4
    assert (moments[0].plan is None) == (driver == "guard")


def test_equal_seeds_give_equal_runs() -> None:
    case = Case("guard", 0.1, False, 1e-3, 3)
    assert run(case, PARAMETERS) == run(case, PARAMETERS)


def test_counted_stops_match_the_watched_moments() -> None:
    moments: list[Moment] = []
    result = run(Case("guard", 0.1, False, 1e-3, 2), PARAMETERS, moments.append)
    stopped = [each.verdict.level == "stop" for each in moments]
    started = sum(
        now and not before for before, now in zip([False, *stopped], stopped, strict=False)
    )
    assert sum(result.stops.values()) == started
    assert result.stopped_s == pytest.approx(0.1 * sum(stopped))
    assert not any(any(c.isdigit() for c in reason.split()[1]) for reason in result.stops)


def test_reasons_are_counted_without_numbers() -> None:
    assert general("sonar 12 detects something approaching") == (
        "sonar detects something approaching"
    )
    assert general("the time to contact with obstacle 3 is short") == (
        "the time to contact with obstacle is short"
    )
    assert general("sonar 3 has an echo within 0.20 m") == "sonar has an echo within 0.20 m"
    weak = "vision is degraded: only 35 % of the points agree on one motion"
    assert general(weak) == "vision is degraded: only … % of the points agree on one motion"


def test_kind_people_cannot_be_combined_with_images() -> None:
    with pytest.raises(ValueError, match="avoid the robot"):
        run(Case("planner", 0.02, True, 1e-3, 1, "images"), PARAMETERS)


@pytest.mark.timeout(240)
def test_empty_hall_is_crossed_with_images() -> None:
    result = run(Case("planner", 0.0, False, 1e-3, 1, "images"), PARAMETERS)
    assert result.reached
    assert result.time_s < 1.2 * free_time_s(LIMITS)
    # Nothing is known before the first pair of frames.
    assert sum(result.stops.values()) <= 2


def test_robot_respects_its_limits_and_reports_contacts() -> None:
    robot = Robot((0.0, 0.0, 0.0), LIMITS)
    for _ in range(10):
        robot.drive(0.5, 0.0, 0.1)
    assert robot.speed_mps == pytest.approx(0.3)
    robot.drive(0.0, 1.0, 0.1)
    assert robot.speed_mps == pytest.approx(0.25)
    assert robot.turn_rate_radps == pytest.approx(0.15)
    x, y, _ = robot.pose
    before = SPEC.length_m / 2 + 0.2
    people = People(
        np.arange(3),
        np.array([[x + before, y], [x - before, y], [x + before + 0.2, y]]),
        np.zeros((3, 2)),
        np.full(3, 0.25),
    )
    assert robot.touched(people) == {0, 1}
    assert robot.drives_up_to(people) == {0, 2}


def test_walk_ranks_every_prediction_that_came_due() -> None:
    result = follow(Walk(0.1, 4), PARAMETERS.navigation)
    for ranked, least in ((result.seen, 50), (result.remembered, 10)):
        assert len(ranked) == len(AHEAD_S)
        assert len(ranked[0]) > len(ranked[1]) > least
        assert all(0 <= rank <= 1 for each in ranked for rank in each)
