"""Distances to a goal: straight through free space, and around obstacles."""

from __future__ import annotations

import math

import numpy as np
import pytest

from observer.guard.sight import FreeScan
from observer.navigation.local_map import LocalMap
from observer.navigation.route import route

RADIUS_M = 0.35


def with_wall(half_width_m: float, ahead_m: float = 2.0) -> LocalMap:
    """Return a map with a wall across the path, extending this far to both sides."""
    local = LocalMap()
    widest = math.atan2(half_width_m, ahead_m)
    bearings = np.linspace(-widest, widest, 61)
    far = tuple((ahead_m / np.cos(bearings)).tolist())
    scan = FreeScan(tuple(bearings.tolist()), far, (0.5,) * len(far), far)
    for k in range(-7, 1):
        local.see(scan, (), np.zeros(3), 0.1 * k)
    return local


@pytest.mark.parametrize("goal", [(3.0, 0.0), (0.0, -2.0), (-2.0, 2.5), (9.0, 4.0)])
def test_the_route_is_straight_through_free_space(goal: tuple[float, float]) -> None:
    way = route(LocalMap(), goal, RADIUS_M, 0.1)
    straight = math.hypot(*goal)
    # Along the grid's eight directions it is up to 8 % longer.
    assert straight - 0.2 < float(way.distance(np.zeros(2))) < 1.09 * straight + 0.2
    off = math.remainder(way.heading(0.0, 0.0, 0.8) - math.atan2(goal[1], goal[0]), math.tau)
    assert abs(off) < 0.4


def test_the_route_leads_around_a_wall() -> None:
    narrow, wide = with_wall(0.5), with_wall(1.2)
    free = float(route(LocalMap(), (4.0, 0.0), RADIUS_M, 0.1).distance(np.zeros(2)))
    around = [
        float(route(each, (4.0, 0.0), RADIUS_M, 0.1).distance(np.zeros(2)))
        for each in (narrow, wide)
    ]
    assert free < around[0] < around[1]
    assert around[1] > 2 * math.hypot(2.0, 1.2) - 0.1
    way = route(narrow, (4.0, 0.0), RADIUS_M, 0.1)
    assert 0.15 < abs(math.remainder(way.heading(0.8, 0.0, 0.8), math.tau)) < 1.6


def test_a_wall_far_from_the_path_changes_nothing() -> None:
    local = LocalMap()
    far = (2.0,) * 9
    bearings = tuple(np.linspace(1.2, 1.6, 9).tolist())
    for k in range(-7, 1):
        local.see(FreeScan(bearings, far, (0.5,) * 9, far), (), np.zeros(3), 0.1 * k)
    assert route(local, (3.0, 0.0), RADIUS_M, 0.1).heading(0.0, 0.0, 0.8) == pytest.approx(0.0)


def test_a_goal_beyond_the_map_is_approached() -> None:
    way = route(LocalMap(), (40.0, 0.0), RADIUS_M, 0.1)
    near, far = way.distance(np.array([[0.0, 0.0], [30.0, 0.0]]))
    assert far == pytest.approx(10.0)
    assert near == pytest.approx(40.0, rel=0.1)
    assert way.heading(0.0, 0.0, 0.8) == pytest.approx(0.0, abs=0.2)
