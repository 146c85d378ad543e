"""Points that drive as one for a while are distinguished from swinging limbs."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from observer.methods.rigid.bodies.steady_drive import SteadyDrive

from .planted_bodies import DT

Speed = Callable[[float], float]


def recognized_after(speed: Speed, points: int = 12, seconds: float = 2.0, every: int = 1) -> float:
    """Seconds until a group at such a speed counts as driving; infinite if it never does."""
    drive = SteadyDrive()
    for k in range(0, int(seconds / DT), every):
        if drive.note(np.array([speed(k * DT), 0.0, 0.0]), points, k * DT):
            return k * DT
    return float("inf")


def test_steady_driving_is_recognized_after_half_a_second() -> None:
    assert recognized_after(lambda _: 0.3) == pytest.approx(0.5, abs=DT)
    assert recognized_after(lambda t: 0.3 + 0.05 * np.sin(9 * t)) == pytest.approx(0.5, abs=DT)


def test_swinging_legs_are_not_recognized_as_steady_driving() -> None:
    """Alternately at twice the walking speed and at rest, averaged over a third of a second."""
    times = np.arange(0, 3, 0.01)
    steps = np.abs(2 * np.sin(np.pi * times)) * 0.9

    def leg(t: float) -> float:
        return float(steps[(times > t) & (times <= t + 0.33)].mean())

    assert recognized_after(leg, seconds=2.5) == float("inf")


def test_few_points_only_bridge_gaps() -> None:
    assert recognized_after(lambda _: 0.3, points=5) == float("inf")
    drive = SteadyDrive()
    velocity = np.array([0.3, 0.0, 0.0])
    for points, at in ((12, 0.0), (4, 0.3), (4, 0.6)):
        assert not drive.note(velocity, points, at)
    assert drive.note(velocity, 12, 0.9)


def test_a_long_gap_restarts_the_steady_drive() -> None:
    drive = SteadyDrive()
    velocity = np.array([0.0, 0.0, -0.3])
    for before, at in pairwise((0.0, 0.5, 1.0, 1.5)):
        assert not drive.note(velocity, 12, before)
        assert not drive.note(velocity, 12, at)


def test_reversing_restarts_the_steady_drive() -> None:
    assert recognized_after(lambda t: 0.3 if t < 0.3 else -0.3) == pytest.approx(0.8, abs=2 * DT)
