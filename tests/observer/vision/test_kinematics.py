"""Kinematics that all methods share: the speed's uncertainty and the closing speed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.vision.kinematics import closing_speed, speed_std


@pytest.mark.parametrize("speed", [0.0, 0.05, 0.2, 1.0, 5.0])
@pytest.mark.parametrize("sigmas", [(0.02, 0.02, 0.02), (0.03, 0.02, 0.4)])
def test_speed_deviation_matches_noisy_velocities(
    speed: float, sigmas: tuple[float, float, float]
) -> None:
    """The stated deviation also holds when noise across the motion only lengthens the vector."""
    rng = np.random.default_rng(0)
    truth = np.array([speed, 0.0, 0.0])
    covariance = np.diag(np.square(sigmas))
    velocities = truth + rng.normal(0, sigmas, (3000, 3))
    error = np.sqrt(np.mean((np.linalg.norm(velocities, axis=1) - speed) ** 2))
    stated = np.median([speed_std(v, covariance) for v in velocities])
    assert 0.5 * error < stated < 1.7 * error


@given(
    st.lists(st.floats(-50, 50), min_size=3, max_size=3),
    st.lists(st.floats(-20, 20), min_size=3, max_size=3),
    st.lists(st.floats(-20, 20), min_size=3, max_size=3),
)
def test_closing_speed_is_the_rate_of_decreasing_distance(
    place: list[float], own: list[float], camera: list[float]
) -> None:
    p, v, c = np.array(place), np.array(own), np.array(camera)
    dt = 1e-6
    if np.linalg.norm(p) < 0.1:
        return
    shrinks = np.linalg.norm(p) - np.linalg.norm(p + (v - c) * dt)
    assert closing_speed(p, v, c) == pytest.approx(shrinks / dt, abs=0.02)


def test_closing_speed_is_finite_at_the_camera() -> None:
    assert closing_speed(np.zeros(3), np.ones(3), np.zeros(3)) == 0
