"""Rendered images show people where the crowd places them, walking as the crowd moves them."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from observer.evaluation.navigation.crowd import People, Room
from observer.evaluation.navigation.imaged import RenderedPerception, walks_of
from observer.guard.parameters import GuardParameters
from observer.types import Status

ROOM = Room(14.0, 10.0)
START = (2.0, 5.0)


def steps(*rows: tuple[float, float, float, float], count: int = 60) -> list[People]:
    """Return steps of people who start at x, y with velocity vx, vy, one every 0.1 s."""
    values = np.array(rows).reshape(-1, 4)
    place, velocity = values[:, :2], values[:, 2:]
    number, radius = np.arange(len(values)), np.full(len(values), 0.22)
    return [People(number, place + velocity * 0.1 * k, velocity, radius) for k in range(count)]


def test_walk_follows_the_crowd_positions() -> None:
    people = steps((5.0, 6.0, 0.6, -0.8))
    (walk,) = walks_of(people, START)
    for k in (0, 7, 59):
        state = walk.state(0.1 * k)
        np.testing.assert_allclose((state.x, state.y), people[k].position[0] - START, atol=1e-9)
        assert (state.vx, state.vy) == pytest.approx((0.6, -0.8))
        assert state.heading == pytest.approx(math.atan2(-0.8, 0.6))
    between = walk.state(0.75)
    assert between.x == pytest.approx(3.0 + 0.6 * 0.75)
    assert walk.commanded_speed(0.75) == pytest.approx(1.0)
    after = walk.state(9.0)
    assert (after.vx, after.vy) == (0.0, 0.0)


def test_stopped_person_keeps_facing_the_walking_direction() -> None:
    forth = steps((5.0, 5.0, 0.0, 1.0), count=20)
    stand = [People(p.number, forth[-1].position, 0 * p.velocity, p.radius_m) for p in forth]
    back = [
        People(p.number, forth[-1].position - [0, 0.1 * k], -p.velocity, p.radius_m)
        for k, p in enumerate(forth)
    ]
    (walk,) = walks_of([*forth, *stand, *back], START)
    headings = [walk.state(0.1 * k).heading for k in range(59)]
    assert headings[:39] == pytest.approx([math.pi / 2] * 39)
    assert math.cos(headings[-1] + math.pi / 2) > 0.98
    # They turn gradually.
    assert max(abs(b - a) for a, b in itertools.pairwise(headings)) < 1.2


@pytest.mark.timeout(120)
def test_rendered_perception_sees_a_crossing_person() -> None:
    people = steps((5.2, 6.4, 0.0, -0.9), count=40)
    perception = RenderedPerception(people, START, 3, GuardParameters())
    seen, free = [], []
    for k in range(24):
        pose = np.array([START[0] + 0.02 * k, START[1], 0.0])
        sight = perception.look(people[k], pose, ROOM, 0.1 * k)
        assert sight.received == pytest.approx(0.1 * k)
        assert sight.scan is not None
        free.append(max(sight.scan.known_to_m))
        if k >= 10:
            assert sight.status is Status.OK
            true = people[k].position[0] - pose[:2]
            near = [o for o in sight.obstacles if math.dist((o.x, o.y), true) < 0.5]
            seen += [(o.x - true[0], o.y - true[1], o.vx, o.vy + 0.9) for o in near]
    assert len(seen) >= 12
    error = np.sqrt((np.array(seen) ** 2).mean(axis=0))
    assert error[:2].max() < 0.2
    assert error[2:].max() < 0.3
    # It sees floor ahead too.
    assert np.median(free) > 1.5
