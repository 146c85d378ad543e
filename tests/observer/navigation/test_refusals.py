"""Rejected paths: really refused, in different directions, and each with a reason."""

from __future__ import annotations

import json
import math
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.geometry import Float64Array
from observer.guard.parameters import GuardParameters
from observer.guard.sight import SeenObstacle
from observer.navigation.futures import Futures, futures
from observer.navigation.local_map import LocalMap
from observer.navigation.parameters import NavigationParameters
from observer.navigation.plan import MOST_REFUSED, Plan, RefusedPath, plan_of
from observer.navigation.planner import TIMES, Choice, choose
from observer.navigation.refusals import SPREAD_RAD, refused_paths
from observer.navigation.rollouts import Motion
from observer.navigation.surroundings import Surroundings

LIMITS, PLANNER = GuardParameters(), NavigationParameters()
GOAL = (5.0, 0.0)
RISK = 1e-3


def person(x: float, y: float, vx: float = 0.0, vy: float = 0.0, number: int = 3) -> SeenObstacle:
    return SeenObstacle(number, x, y, vx, vy, 0.3, 0.05, 0.1, False)


class Room:
    """A robot at the origin that drives along x to a goal ahead.

    Args:
        share: of every velocity that the guard permits, with ``sentence`` as its reason.
    """

    def __init__(self, *people: SeenObstacle, share: float = 1.0, sentence: str = "no") -> None:
        self.now = Motion(0.0, 0.0, 0.0, 0.4, 0.0)
        weights = np.tile(PLANNER.prior, (len(people), 1))
        self.people: Futures = futures(people, weights, TIMES, PLANNER.acceleration_noise)
        around = Surroundings.of(LocalMap(), GOAL, self.now, 0.36, 10.0)
        self.choice: Choice = choose(
            *(self.now, around, self.people, LIMITS, PLANNER, RISK),
            permits=lambda _: (share, sentence),
        )
        self.refused = refused_paths(self.choice, self.people, self.now, GOAL)

    def way(self, path: RefusedPath) -> int:
        """Return the index of the planner's only path that matches."""
        ends = self.choice.ways.poses[:, -1, :2]
        peak = self.choice.ways.speed.max(axis=1)
        off = np.hypot(*(ends - path.path[-1]).T) + np.abs(peak - path.speed_mps)
        (way,) = np.flatnonzero(off < 0.02)
        return int(way)


def test_no_path_is_refused_in_free_space() -> None:
    assert Room().refused == ()
    assert Room(person(-2.0, 0.0, -1.0)).refused == ()


def test_paths_meeting_a_person_are_refused_with_track_and_time() -> None:
    room = Room(person(1.0, 1.0, 0.0, -1.2), person(4.0, 4.0, 1.0, 1.0, number=8))
    straight = room.refused[0]
    assert straight.direction == pytest.approx(0.0, abs=0.02)
    assert straight.cause == "risk"
    assert (straight.track, straight.guard) == (3, None)
    # It walks a metre before it is in the robot's way.
    assert straight.meets_s == pytest.approx(1.0 / 1.2, abs=0.3)
    for path in room.refused:
        assert path.track == 3
        way = room.way(path)
        if path.cause == "risk":
            assert not room.choice.permitted[way]
            assert path.risk is not None
            assert RISK < path.risk <= 1
        else:
            assert path.cause == "later"
            assert room.choice.cost[way] > room.choice.cost[room.choice.best]


def test_paths_refused_by_the_guard_carry_its_reason() -> None:
    sentence = "an obstruction ahead is within the stopping distance"
    room = Room(share=0.0, sentence=sentence)
    assert room.choice.is_standstill
    assert len(room.refused) > 2
    assert {(path.cause, path.track, path.guard) for path in room.refused} == {
        ("guard", None, sentence)
    }
    slower = Room(share=0.5, sentence=sentence)
    assert not slower.choice.is_standstill
    assert slower.refused == ()


_PLACE, _SPEED = st.floats(-4.0, 4.0), st.floats(-1.5, 1.5)
_PEOPLE = st.lists(st.tuples(_PLACE, _PLACE, _SPEED, _SPEED), max_size=5)


@settings(max_examples=60)
@given(_PEOPLE, st.sampled_from([0.0, 0.5, 1.0]))
def test_refused_paths_are_not_taken_and_differ_in_direction(
    people: list[tuple[float, float, float, float]], share: float
) -> None:
    room = Room(*(person(*one, number=k) for k, one in enumerate(people)), share=share)
    choice = room.choice
    assert len(room.refused) <= MOST_REFUSED
    for one, other in combinations(room.refused, 2):
        gap = abs(math.remainder(one.direction - other.direction, 2 * math.pi))
        assert gap >= SPREAD_RAD - 0.002
    for path in room.refused:
        assert np.isfinite(np.array(path.path)).all()
        assert 2 <= len(path.path) <= 5
        assert path.direction == pytest.approx(math.atan2(*reversed(path.path[-1])), abs=0.05)
        assert (path.cause == "guard") == (path.guard is not None)
        if path.cause in ("risk", "later"):
            assert path.track in room.people.ids
            assert path.meets_s in TIMES.round(3)
            assert path.risk is not None
            assert 0 < path.risk <= 1
        taken: Float64Array = choice.ways.poses[choice.best, -1, :2]
        same = np.hypot(*(taken - path.path[-1])) < 0.01
        assert not same or path.speed_mps > choice.ways.speed[choice.best].max() - 0.01


_NUMBERS = st.floats(-1e3, 1e3)
_PAIRS = st.tuples(_NUMBERS, _NUMBERS)
_REFUSED = st.builds(
    RefusedPath,
    direction=_NUMBERS,
    speed_mps=_NUMBERS,
    path=st.lists(_PAIRS, max_size=5).map(tuple),
    cause=st.sampled_from(["risk", "later", "guard", "surface"]),
    risk=st.none() | _NUMBERS,
    track=st.none() | st.integers(-9, 99),
    meets_s=st.none() | _NUMBERS,
    guard=st.none() | st.text(max_size=20),
)


@given(st.lists(_REFUSED, max_size=MOST_REFUSED).map(tuple), st.none() | _PAIRS)
def test_a_plan_survives_a_json_round_trip(
    refused: tuple[RefusedPath, ...], meets_at: tuple[float, float] | None
) -> None:
    made = Plan(1, 2.0, 0.3, 0.1, ((0.1, 0.0),), 1e-4, "On.", 3, 1.4, meets_at, refused)
    assert plan_of(json.loads(json.dumps(made.facts()))) == made


def test_an_encoded_plan_stays_small() -> None:
    crowd = [person(0.9 + 0.2 * k, (-1.0) ** k, 0.0, -((-1.0) ** k), number=k) for k in range(9)]
    room = Room(*crowd)
    assert room.refused
    made = Plan(1, 2.0, 0.0, 0.0, (), 0.0, "Waiting.", refused=room.refused)
    # Bytes, of the slot's 256 KB.
    assert len(json.dumps(made.facts())) < 2500
