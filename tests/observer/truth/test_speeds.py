"""Velocities from positions: exact for the modelled motion, absent where data is missing."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import savgol_filter

from observer.geometry import Float64Array
from observer.truth.speeds import smoothed_velocity

NUMBERS = st.floats(-5, 5)


def parabola(times: Float64Array, *, seed: int = 0) -> tuple[Float64Array, Float64Array]:
    """Return positions and velocities of constant acceleration."""
    a, b, c = np.random.default_rng(seed).uniform(-2, 2, (3, 3))
    t = times[:, None]
    return a + b * t + c * t**2, b + 2 * c * t


@given(st.integers(0, 100), st.floats(0, 1e6), st.booleans())
def test_velocity_is_exact_for_constant_acceleration_at_any_steps(
    seed: int, start: float, equal: bool
) -> None:
    steps = np.random.default_rng(seed).uniform(0.008, 0.011, 60)
    times = np.arange(60) / 100 if equal else np.cumsum(steps)
    positions, velocities = parabola(times, seed=seed)
    found = smoothed_velocity(start + times, positions)
    np.testing.assert_allclose(found[5:-5], velocities[5:-5], atol=1e-6)
    assert np.isnan(found[:5]).all()
    assert np.isnan(found[-5:]).all()


@pytest.mark.parametrize(("window", "order"), [(11, 2), (7, 3), (5, 1)])
def test_equal_steps_match_savitzky_golay(window: int, order: int) -> None:
    positions = np.random.default_rng(0).normal(0, 1, (100, 3))
    found = smoothed_velocity(np.arange(100) / 250, positions, window=window, order=order)
    expected = savgol_filter(positions, window, order, deriv=1, delta=1 / 250, axis=0)
    half = window // 2
    np.testing.assert_allclose(found[half:-half], expected[half:-half], atol=1e-8)


def test_velocity_is_unknown_where_the_window_touches_a_gap_or_jump() -> None:
    times = np.arange(100) / 100
    positions, _ = parabola(times)
    positions[30] = np.nan
    times[60:] += 0.01
    unknown = np.isnan(smoothed_velocity(times, positions)).all(axis=1)
    assert np.flatnonzero(unknown).tolist() == [*range(5), *range(25, 36), *range(55, 65),
                                                *range(95, 100)]  # fmt: skip


def test_long_trajectories_are_fitted_piece_by_piece() -> None:
    for steps in (np.full(45_000, 0.01), np.random.default_rng(0).uniform(0.009, 0.011, 45_000)):
        times = np.cumsum(steps)
        positions = np.sin(times)[:, None] * np.ones(3)
        found = smoothed_velocity(times, positions)
        np.testing.assert_allclose(found[5:-5, 1], np.cos(times)[5:-5], atol=1e-3)


@pytest.mark.parametrize("count", [0, 1, 2, 10])
def test_too_few_samples_give_no_speed(count: int) -> None:
    times = np.arange(float(count))
    positions = np.zeros((count, 3))
    assert np.isnan(smoothed_velocity(times, positions)).all()


@pytest.mark.parametrize(("window", "order"), [(10, 2), (3, 3), (5, 0)])
def test_impossible_window_or_order_is_refused(window: int, order: int) -> None:
    with pytest.raises(ValueError, match="window must be odd and larger than order"):
        smoothed_velocity(np.arange(20.0), np.zeros((20, 3)), window=window, order=order)
