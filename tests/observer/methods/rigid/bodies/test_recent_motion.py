"""The memory of a body's recent motion."""

from __future__ import annotations

import numpy as np
import pytest

from observer.methods.rigid.bodies.recent_motion import RecentMotion


def remembered(seconds: float, acceleration: float, rate: float = 15.0) -> RecentMotion:
    """Memory of a body that accelerated from rest for ``seconds``."""
    recent = RecentMotion()
    for k in range(round(seconds * rate) + 1):
        recent.note(k / rate, np.array([acceleration * k / rate, 0.0, 0.0]), 0.1)
    return recent


def test_an_empty_memory_gives_no_instants_and_no_acceleration() -> None:
    ago, moved = RecentMotion().instants()
    assert ago.shape == (0,)
    assert moved.shape == (0, 4)
    assert RecentMotion().acceleration(np.array([0.5])).tolist() == [0.0]


@pytest.mark.parametrize("rate", [7.0, 15.0, 60.0])
def test_the_instants_reach_back_as_far_as_the_memory_of_points(rate: float) -> None:
    ago, moved = remembered(10.0, 0.3, rate).instants()
    assert len(ago) <= 16
    assert (ago[-1], ago[0]) == pytest.approx((0.0, 3.5), abs=1 / rate)
    assert (np.diff(ago) < 0).all()
    assert moved[:, 0] == pytest.approx(0.3 * (10.0 - ago), abs=0.3 / rate)
    assert moved[:, 3] == pytest.approx(0.1)


def test_acceleration_is_velocity_change_over_elapsed_time() -> None:
    recent = remembered(2.0, 0.3)
    assert recent.acceleration(np.array([0.2, 1.0, 2.0])) == pytest.approx(0.3)
    # Before it was first seen, it is assumed to have moved as it did then.
    assert recent.acceleration(np.array([4.0])) == pytest.approx(0.15)


def test_the_motion_at_any_time_lies_between_those_noted() -> None:
    recent = remembered(2.0, 0.3)
    assert recent.known_s == pytest.approx(2.0)
    then = recent.at(np.array([0.0, 0.5, 1.3, 9.0]))
    assert then[:, 0] == pytest.approx([0.6, 0.45, 0.21, 0.0], abs=0.01)
    assert then[:, 3] == pytest.approx(0.1)
    recent.forget()
    assert recent.known_s == 0.0


def test_a_forgotten_motion_has_no_past() -> None:
    recent = remembered(2.0, 0.3)
    recent.forget()
    recent.note(9.0, np.array([1.0, 0, 0]), 0.0)
    ago, moved = recent.instants()
    assert ago.tolist() == [0.0]
    assert moved[0].tolist() == [1.0, 0, 0, 0]
