"""Motion of a driven body between and beyond its steps."""

from __future__ import annotations

import math
import threading

import pytest

from observer.simulation.motion import Parked, PlanarState
from observer.simulation.robots.driven import Driven


def test_motion_is_interpolated_between_steps_and_extrapolated_after_the_last() -> None:
    motion = Driven(Parked(1.0, 2.0, 0.0), threading.RLock())
    assert motion.state(5.0) == PlanarState(1.0, 2.0, 0.0)
    motion.begin(5.0, PlanarState(1.0, 2.0, 0.0))
    for k in range(1, 5):
        motion.add(5.0 + k / 100, PlanarState(1.0 + k / 100, 2.0, 0.0, 1.0), 1.0)
    assert motion.state(4.0) == PlanarState(1.0, 2.0, 0.0)
    assert motion.state(5.025).x == pytest.approx(1.025)
    assert motion.state(5.005).vx == pytest.approx(0.5)
    assert motion.state(5.09).x == pytest.approx(1.09)
    assert motion.state(9.0).x < 1.5
    assert (motion.commanded_speed(4.9), motion.commanded_speed(5.02)) == (0.0, 1.0)
    motion.add(5.05, PlanarState(1.05, 2.0, 0.0, 1.0, 0.0, math.pi), 1.0)
    turned = motion.state(5.15)
    assert turned.heading == pytest.approx(0.1 * math.pi)
    assert turned.x == pytest.approx(1.05 + math.sin(0.1 * math.pi) / math.pi)
    assert turned.y == pytest.approx(2.0 + (1 - math.cos(0.1 * math.pi)) / math.pi)
    motion.forget()
    assert motion.state(5.025) == PlanarState(1.0, 2.0, 0.0)


def test_times_before_the_memory_give_the_oldest_known_state() -> None:
    motion = Driven(Parked(0.0, 0.0, 0.0), threading.RLock())
    motion.begin(0.0, PlanarState(0.0, 0.0, 0.0))
    for k in range(1, 3000):
        motion.add(k / 100, PlanarState(k / 100, 0.0, 0.0, 1.0), 1.0)
    assert motion.state(25.0).x == pytest.approx(25.0)
    assert motion.state(1.0).x == pytest.approx(20.0)
    assert motion.state(0.0).x == 0.0
