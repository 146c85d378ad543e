from __future__ import annotations

import numpy as np
import pytest

from observer.simulation.odometry import SimulatedOdometry
from observer.simulation.scenarios import load_scenario
from observer.simulation.source import SimulatedSource
from observer.simulation.world import World


def driven(world: World, seconds: float) -> np.ndarray:
    wheels = SimulatedOdometry(world)
    read = [wheels.read(k / 15) for k in range(int(seconds * 15))]
    return np.array([(o.x, o.y, o.yaw) for o in read])


def test_odometry_is_close_to_the_true_distance_but_not_exact() -> None:
    errors = []
    for seed in range(1, 13):
        world = World(load_scenario("lateral"), seed)
        last = driven(world, 8)[-1]
        start, end = world.observer.motion.state(0), world.observer.motion.state(119 / 15)
        true = np.hypot(end.x - start.x, end.y - start.y)
        errors.append(np.hypot(*last[:2]) / true - 1)
    assert 0.002 < np.std(errors) < 0.03
    assert np.abs(errors).max() < 0.05


def test_a_rewound_source_gives_the_same_odometry_again() -> None:
    source = SimulatedSource(World(load_scenario("lateral"), 5))
    first = [source.read().odometry for _ in range(4)]
    source.rewind()
    assert [source.read().odometry for _ in range(4)] == first
    assert first[0] is not None
    assert (first[0].x, first[0].y, first[0].yaw) == (0, 0, 0)


def test_stationary_wheels_report_no_motion() -> None:
    world = World(load_scenario("lab"), 0)
    still = World(world.scenario.model_copy(update={"observer": type(world.scenario.observer)()}))
    np.testing.assert_array_equal(driven(still, 2), 0)


def test_turns_accumulate_with_a_small_drift() -> None:
    world = World(load_scenario("static_turning"), 3)
    yaw = driven(world, 1.5)[-1, 2]
    start, end = world.observer.motion.state(0), world.observer.motion.state(21 / 15)
    assert yaw == pytest.approx(end.heading - start.heading, rel=0.05)
