"""The simulated observer errs by the given amounts, and does not see through bodies."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from observer.evaluation.navigation.crowd import People, Room
from observer.evaluation.navigation.perceived import ModelledPerception, SonarRing, in_view, ranges
from observer.robots.models import robot_spec

ROOM = Room(14.0, 10.0)
POSE = np.array([2.0, 5.0, 0.0])


def people(*rows: tuple[float, float, float, float]) -> People:
    values = np.array(rows).reshape(-1, 4)
    return People(np.arange(len(values)), values[:, :2], values[:, 2:], np.full(len(values), 0.25))


def test_only_near_unhidden_people_ahead_are_in_view() -> None:
    crowd = people(
        (5.0, 5.0, 0, 0),
        (6.0, 5.05, 0, 0),  # behind the first
        (5.0, 7.5, 0, 0),  # beside the view
        (9.0, 5.0, 0, 0),  # too far
        (4.0, 4.0, 0, 0),
    )
    assert in_view(crowd, POSE).tolist() == [True, False, False, False, True]
    assert not in_view(crowd, np.array([2.0, 5.0, math.pi])).any()
    assert not in_view(people((2.6, 5.0, 0, 0)), POSE).any()  # too near


def test_person_becomes_a_track_after_a_delay_and_coasts_when_lost() -> None:
    perception = ModelledPerception(1)
    seen = [perception.look(people((5.0, 5.0, 0, 0)), POSE, ROOM, 0.1 * k) for k in range(8)]
    assert [len(each.obstacles) for each in seen] == [0, 0, 0, 0, 1, 1, 1, 1]
    lost = [perception.look(people((5.0, 9.5, 0, 0)), POSE, ROOM, 0.8 + 0.1 * k) for k in range(9)]
    assert all(one.coasting for each in lost for one in each.obstacles)
    assert len(lost[0].obstacles) == 1
    assert len(lost[-1].obstacles) == 0


def test_errors_match_the_stated_sigmas() -> None:
    perception, walker = ModelledPerception(2), people((5.0, 5.0, 0.5, -0.5))
    errors, coasting = [], 0
    for k in range(3000):
        for one in perception.look(walker, POSE, ROOM, 0.1 * k).obstacles:
            coasting += one.coasting
            if not one.coasting:
                errors.append([one.x - 3.0, one.y, one.vx - 0.5, one.vy + 0.5])
                assert (one.position_sigma_m, one.velocity_sigma_mps) == (0.06, 0.1)
    assert np.std(errors, axis=0) == pytest.approx([0.06, 0.06, 0.1, 0.1], rel=0.12)
    assert np.mean(errors, axis=0) == pytest.approx([0, 0, 0, 0], abs=0.02)
    assert coasting / 3000 == pytest.approx(0.04, abs=0.012)


def test_rays_end_at_bodies_and_walls() -> None:
    far = ranges(people((5.0, 5.0, 0, 0)), ROOM, POSE[:2], np.radians([0.0, 90.0, 180.0, 20.0]))
    assert far == pytest.approx([2.75, 5.0, 2.0, 12.0 / math.cos(math.radians(20))])


def test_equal_seeds_see_the_same() -> None:
    walkers = people((5.0, 5.0, 0.5, 0.0), (6.0, 6.0, -0.5, 0.3))
    one, other = ModelledPerception(3), ModelledPerception(3)
    for k in range(10):
        seen = [perception.look(walkers, POSE, ROOM, 0.1 * k) for perception in (one, other)]
        assert seen[0] == seen[1]


def test_sonar_detects_a_person_beside_the_camera() -> None:
    ring = robot_spec("p3dx-sh").sonars
    quiet = SonarRing(ring).listen(people(), ROOM, POSE, 1.0)
    near = SonarRing(ring).listen(people((2.0, 6.0, 0, 0)), ROOM, POSE, 1.0)
    assert len(near) == 16
    before = {each.index: each.range_m for each in quiet}
    changed = {each.index for each in near if before[each.index] != each.range_m}
    assert {0, 15} <= changed
    heard = next(each.range_m for each in near if each.index == 0)
    assert heard is not None
    assert heard == pytest.approx(1.0 - 0.25 - ring[0].y, abs=0.02)
    assert all(each.received == 1.0 for each in near)


def test_sonars_of_an_array_fire_in_turn() -> None:
    ring = SonarRing(robot_spec("p3dx-sh").sonars)
    new = []
    for k in range(40):
        heard = ring.listen(people(), ROOM, POSE, 0.1 * k)
        new.append({each.index for each in heard if each.received == 0.1 * k})
    # Each array fires a sonar every 40 ms: 25 per second each, so 2 or 3 per packet.
    assert {len(each) for each in new[1:]} == {4, 6}
    assert sum(map(len, new[10:20])) == 50
    # Both arrays fire at once; each sonar fires again after 0.3 or 0.4 s.
    assert all({(k + 8) % 16 for k in each} == each for each in new)
    left = [k for k, each in enumerate(new) if 0 in each]
    assert {b - a for a, b in itertools.pairwise(left)} <= {3, 4}
