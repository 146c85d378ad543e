"""People of the navigation benchmark: equal for equal seeds, separated, and never stuck."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass

import numpy as np
import pytest

from observer.errors import InputError
from observer.evaluation.navigation.crowd import Crowd, People, Room
from observer.geometry import Float64Array

pytest.importorskip("jupedsim", reason="needs the extra crowd, which brings jupedsim")

ROOM = Room(12.0, 10.0)
DENSITY = 0.3
DT = 0.1
ROBOT_RADIUS = 0.3
MIDDLE = (6.0, 5.0, 0.0, 0.0, ROBOT_RADIUS)


def crowd(seed: int = 1, *, kind: bool = False, density: float = DENSITY) -> Crowd:
    return Crowd(ROOM, density, seed, kind=kind, keep_clear=(6.0, 5.0, 1.0))


@dataclass(frozen=True, eq=False)
class Walk:
    """A minute of N people around a robot at rest in the middle.

    Attributes:
        position: (T, N, 2). velocity: (T, N, 2). radius_m: (N,).
    """

    position: Float64Array
    velocity: Float64Array
    radius_m: Float64Array

    @property
    def speed(self) -> Float64Array:
        return np.hypot(self.velocity[..., 0], self.velocity[..., 1])

    @property
    def from_robot(self) -> Float64Array:
        """Clearance of each body from the robot's, (T, N), metres."""
        away = self.position - MIDDLE[:2]
        return np.hypot(away[..., 0], away[..., 1]) - self.radius_m - ROBOT_RADIUS


def walked(*, kind: bool) -> Walk:
    people = crowd(kind=kind)
    seen: list[People] = []
    for _ in range(600):
        people.step(DT, MIDDLE)
        seen.append(people.people)
    return Walk(
        np.array([each.position for each in seen]),
        np.array([each.velocity for each in seen]),
        seen[0].radius_m,
    )


@pytest.fixture(scope="module")
def hard() -> Walk:
    return walked(kind=False)


@pytest.fixture(scope="module")
def kind() -> Walk:
    return walked(kind=True)


@pytest.fixture(params=["hard", "kind"])
def walk(request: pytest.FixtureRequest) -> Walk:
    chosen: Walk = request.getfixturevalue(request.param)
    return chosen


def overlap(position: Float64Array, radius_m: Float64Array) -> Float64Array:
    """Return how far each body (N,) overlaps another, metres; below 0 where it touches none."""
    away = position[:, None] - position[None]
    gap = np.hypot(away[..., 0], away[..., 1]) - radius_m[:, None] - radius_m
    np.fill_diagonal(gap, np.inf)
    deepest: Float64Array = -gap.min(axis=1)
    return deepest


@pytest.mark.parametrize("kind", [False, True])
def test_equal_seeds_give_exactly_equal_people(kind: bool) -> None:
    one, other = crowd(7, kind=kind), crowd(7, kind=kind)
    for k in range(50):
        robot = (6.0 + 0.05 * k, 5.0, 0.5, 0.0, ROBOT_RADIUS)
        one.step(DT, robot)
        other.step(DT, robot)
    assert np.array_equal(one.people.position, other.people.position)
    assert np.array_equal(one.people.velocity, other.people.velocity)
    assert np.array_equal(one.people.radius_m, other.people.radius_m)


def test_different_seeds_give_different_people() -> None:
    one, other = crowd(1).people, crowd(2).people
    assert not np.isclose(one.position, other.position).any(axis=1).all()
    assert not np.allclose(one.radius_m, other.radius_m)


def test_hard_and_kind_people_start_alike() -> None:
    one, other = crowd(kind=False).people, crowd(kind=True).people
    assert np.array_equal(one.position, other.position)
    assert np.array_equal(one.velocity, other.velocity)


def test_density_determines_the_number_of_people() -> None:
    people = crowd(density=0.3).people
    assert len(people.number) == 36
    assert list(people.number) == list(range(36))
    speed = np.hypot(people.velocity[:, 0], people.velocity[:, 1])
    assert speed.min() >= 0.5
    assert speed.max() <= 1.8
    assert people.radius_m.min() >= 0.2
    assert people.radius_m.max() <= 0.25


def test_empty_room_stays_empty() -> None:
    empty = crowd(density=0.0, kind=True)
    empty.step(DT, MIDDLE)
    assert empty.people.position.shape == (0, 2)
    assert empty.people.velocity.shape == (0, 2)


@pytest.mark.parametrize("seed", range(5))
def test_people_start_clear_of_the_robot_and_each_other(seed: int) -> None:
    people = crowd(seed).people
    away = people.position - MIDDLE[:2]
    assert (np.hypot(away[:, 0], away[:, 1]) - people.radius_m).min() >= 1.0
    assert overlap(people.position, people.radius_m).max() < 0


def test_people_stay_in_the_room(walk: Walk) -> None:
    body = walk.radius_m[:, None]
    assert (walk.position - body).min() > 0
    assert (ROOM.size - walk.position - body).min() > 0


def test_bodies_barely_overlap(walk: Walk) -> None:
    deepest = [overlap(each, walk.radius_m).max() for each in walk.position]
    assert max(deepest) < 0.05


def test_people_keep_moving_for_a_minute(walk: Walk) -> None:
    assert np.median(walk.speed) > 0.5
    assert np.median(walk.speed[-100:]) > 0.5
    # No one is stuck: within 20 s everyone has moved elsewhere.
    went = walk.position[200:] - walk.position[:-200]
    assert np.hypot(went[..., 0], went[..., 1]).max(axis=0).min() > 2.0


def test_velocity_matches_the_positions(hard: Walk) -> None:
    mean = (hard.position[1:] - hard.position[:-1]) / DT
    # The velocity is that of the second half of a step.
    assert np.median(np.abs(mean - hard.velocity[1:])) < 0.05
    assert hard.speed.max() <= 1.8 + 1e-9


def test_people_stop_and_go(walk: Walk) -> None:
    stationary = walk.speed < 0.05
    # For at least 1 s at a stretch.
    long = np.lib.stride_tricks.sliding_window_view(stationary, 10, axis=0).all(axis=-1)
    paused = long.any(axis=0)
    assert paused.mean() > 0.3
    # Everyone who stood still walks again, except those who have just stopped.
    assert (walk.speed[-50:].max(axis=0) > 0.3).mean() > 0.9


def test_hard_people_hit_the_robot_and_kind_ones_avoid_it(hard: Walk, kind: Walk) -> None:
    assert (hard.from_robot.min(axis=1) < 0).mean() > 0.2
    assert (kind.from_robot.min(axis=1) < 0).mean() < 0.02
    assert kind.from_robot.min() > -0.05
    assert np.percentile(kind.from_robot, 2) > np.percentile(hard.from_robot, 2) + 0.2


def test_kind_people_avoid_the_robots_current_place() -> None:
    """It appears where no one has seen it before."""
    people = crowd(3, kind=True)
    robot = (3.0, 2.5, 0.0, 0.0, ROBOT_RADIUS)
    for _ in range(50):
        people.step(DT, MIDDLE)
    nearest = []
    for k in range(150):
        people.step(DT, robot)
        away = people.people.position - robot[:2]
        clear = np.hypot(away[:, 0], away[:, 1]) - people.people.radius_m - ROBOT_RADIUS
        # People who were there when it appeared need time to leave.
        if k > 20:
            nearest.append(clear.min())
    assert min(nearest) > -0.05


def test_robot_at_a_wall_outside_or_inside_a_person_is_tolerated() -> None:
    people = crowd(4, kind=True)
    x, y = people.people.position[0]
    for robot in [
        (0.0, 0.0, 0.0, 0.0, 0.3),
        (12.0, 10.0, 1.0, 1.0, 0.3),
        (-1.0, 5.0, -0.5, 0.0, 0.3),
        (float(x), float(y), 0.7, 0.0, 0.3),
    ]:
        people.step(DT, robot)
    assert np.isfinite(people.people.position).all()


def test_steps_must_be_multiples_of_the_simulation_step() -> None:
    fine, coarse = crowd(), crowd()
    for _ in range(4):
        fine.step(0.05, MIDDLE)
    coarse.step(0.2, MIDDLE)
    assert np.array_equal(fine.people.position, coarse.people.position)
    with pytest.raises(ValueError, match=r"multiple of 0\.05 s"):
        fine.step(0.03, MIDDLE)


@pytest.mark.parametrize(
    ("room", "density", "words"),
    [
        (Room(4.0, 4.0), 4.0, "64 people do not fit"),
        (Room(4.0, 1.0), 0.3, "at least 2 m"),
        (Room(float("nan"), 4.0), 0.3, "at least 2 m"),
        (ROOM, -0.1, "not below 0"),
        (ROOM, float("inf"), "not below 0"),
    ],
)
def test_impossible_crowd_is_refused(room: Room, density: float, words: str) -> None:
    with pytest.raises(InputError, match=words):
        Crowd(room, density, 1, kind=False, keep_clear=(2.0, 2.0, 0.5))


def test_missing_jupedsim_is_refused_naming_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    with pytest.raises(InputError, match=r"pip install 'dynamic-observer\[crowd\]'"):
        crowd()
