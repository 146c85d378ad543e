"""The oracle is no slower than any driver, and people who will have left do not block it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from observer.evaluation.navigation import oracle
from observer.evaluation.navigation.crowd import People, crowd_missing
from observer.evaluation.navigation.oracle import Question, ask
from observer.evaluation.navigation.run import Case, free_time_s, run
from observer.guard.parameters import GuardParameters
from observer.navigation.parameters import AllParameters

LIMITS = GuardParameters()


class Scripted:
    """A crowd with prescribed places and velocities: (x, y, vx, vy) of each."""

    def __init__(self, *rows: tuple[float, float, float, float]) -> None:
        self._rows = np.array(rows, np.float64).reshape(-1, 4)
        self._time = 0.0

    def step(self, dt: float, robot: Sequence[float]) -> None:
        del robot
        self._time += dt

    @property
    def people(self) -> People:
        rows = self._rows
        place = rows[:, :2] + rows[:, 2:] * self._time
        return People(np.arange(len(rows)), place, rows[:, 2:], np.full(len(rows), 0.25))


def answer(monkeypatch: pytest.MonkeyPatch, *rows: tuple[float, float, float, float]) -> float:
    monkeypatch.setattr(oracle, "Crowd", lambda *_, **__: Scripted(*rows))
    time = ask(Question(0.1, 1), LIMITS).time_s
    assert time is not None
    return time


def test_empty_room_takes_the_free_time(monkeypatch: pytest.MonkeyPatch) -> None:
    assert answer(monkeypatch) == pytest.approx(free_time_s(LIMITS), abs=0.15)


def test_person_who_leaves_in_time_costs_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    # On the robot's path two metres ahead, but gone by the time it arrives.
    assert answer(monkeypatch, (4.0, 5.0, 0.0, 1.0)) == pytest.approx(answer(monkeypatch))


def test_oracle_goes_around_a_blocking_wall_of_people(monkeypatch: pytest.MonkeyPatch) -> None:
    wall = [(7.0, y, 0.0, 0.0) for y in np.arange(0.0, 7.0, 0.4).tolist()]
    # Past the end of a wall at (7, 6.4) with 0.46 m clearance: two legs of at least 5.34 m.
    distance = 2 * np.hypot(5.0, 6.4 + 0.46 - 5.0) - 0.25
    least = distance / LIMITS.speed_max_mps + free_time_s(LIMITS) - 9.75 / LIMITS.speed_max_mps
    # It grows an octagon, so its time may be up to 8 % shorter.
    assert 0.92 * least <= answer(monkeypatch, *wall) <= least + 0.3


def test_closed_wall_of_people_is_not_passed(monkeypatch: pytest.MonkeyPatch) -> None:
    wall = [(7.0, y, 0.0, 0.0) for y in np.arange(0.0, 10.1, 0.4).tolist()]
    monkeypatch.setattr(oracle, "Crowd", lambda *_, **__: Scripted(*wall))
    assert ask(Question(0.1, 1), LIMITS).time_s is None


@pytest.mark.skipif(crowd_missing() is not None, reason="JuPedSim is not installed")
def test_no_run_is_faster_than_the_oracle() -> None:
    best = ask(Question(0.03, 5), LIMITS).time_s
    driven = run(Case("planner", 0.03, False, 1e-3, 5), AllParameters())
    assert best is not None
    assert driven.reached
    # A run's time includes the whole step in which the goal is reached.
    assert best <= driven.time_s + 0.1
