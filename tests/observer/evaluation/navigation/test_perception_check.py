"""What a robot perceives is judged against the true positions of people."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from observer.evaluation.navigation.crowd import People
from observer.evaluation.navigation.perceived import in_view
from observer.evaluation.navigation.perception_check import PerceptionChecker, perception_figures
from observer.guard.sight import SeenObstacle, Sight
from observer.types import Status

# The robot is at (2, 5) and looks left, along y.
POSE = np.array([2.0, 5.0, np.pi / 2])
# One person walks across 3 m ahead; one stands 4 m ahead and 1 m to the left.
PEOPLE = People(
    np.array([4, 7]),
    np.array([(2.0, 8.0), (1.0, 9.0)]),
    np.array([(1.0, 0.0), (0.0, 0.0)]),
    np.array([0.25, 0.25]),
)
WALKER = SeenObstacle(1, 3.0, 0.0, 0.0, -1.0, 0.3, 0.1, 0.1, False)


def sight(*obstacles: SeenObstacle, status: Status = Status.OK) -> Sight:
    return Sight(1, 0.0, 0.0, "crowd", status, (), True, obstacles)


def test_person_walking_in_view_becomes_due() -> None:
    check = PerceptionChecker()
    for _ in range(10):
        check.add_sight(sight(WALKER), PEOPLE, POSE, in_view(PEOPLE, POSE))
    for _ in range(2):
        check.add_sight(sight(), PEOPLE, POSE, in_view(PEOPLE, POSE))
    found = check.result()
    # Nothing is due in the first half second, and a standing person never is.
    assert (found.frames, found.usable, found.due, found.found) == (12, 12, 6, 4)
    assert (found.false, found.surplus) == (0, 0)
    assert found.velocity_errors == pytest.approx([0.0] * 20, abs=1e-12)
    assert found.covered == 20


def test_errors_false_and_surplus_tracks_are_counted() -> None:
    check = PerceptionChecker()
    again = replace(WALKER, id=2, x=3.2)
    nowhere = replace(WALKER, id=3, y=-2.5)
    off = replace(WALKER, vx=0.5)
    check.add_sight(sight(off, again, nowhere), PEOPLE, POSE, in_view(PEOPLE, POSE))
    found = check.result()
    assert (found.false, found.surplus, found.covered) == (1, 1, 1)
    assert found.velocity_errors == pytest.approx((0.5, 0.0), abs=1e-12)


def test_tentative_and_coasting_tracks_do_not_count() -> None:
    check = PerceptionChecker()
    check.add_sight(
        sight(replace(WALKER, id=-3), replace(WALKER, coasting=True)),
        PEOPLE,
        POSE,
        in_view(PEOPLE, POSE),
    )
    assert check.result().velocity_errors == ()


def test_nothing_is_due_while_vision_is_degraded() -> None:
    check = PerceptionChecker()
    for _ in range(10):
        check.add_sight(sight(WALKER, status=Status.DEGRADED), PEOPLE, POSE, in_view(PEOPLE, POSE))
    found = check.result()
    assert (found.frames, found.usable, found.due) == (10, 0, 0)
    figures = perception_figures([found])
    assert figures is not None
    assert (figures.usable, figures.recall) == (0.0, None)


def test_empty_room_gives_only_false_tracks() -> None:
    check = PerceptionChecker()
    empty = People(np.zeros(0, np.intp), np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))
    check.add_sight(sight(WALKER), empty, POSE, in_view(empty, POSE))
    assert check.result().false == 1
    assert perception_figures([]) is None
