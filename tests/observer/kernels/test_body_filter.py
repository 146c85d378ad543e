"""The kernels of a body's filter against the same formulas by numpy."""

from __future__ import annotations

import numpy as np
import pytest

from observer.kernels.body_filter import mixed, predict, squared_gap, update, velocity_at_centre

from .oracles import body_filter as oracle

ACCELERATION = (0.1, 1.0)
YAW_ACCELERATION = (0.3, 5.0)


def modes_of(seed: int, sigma: float = 0.1) -> oracle.Modes:
    rng = np.random.default_rng(seed)
    means = rng.normal(0.0, 1.0, (2, 8))
    factor = rng.normal(0.0, sigma, (2, 8, 8))
    first = rng.uniform(0.01, 0.99)
    covariances = factor @ factor.transpose(0, 2, 1) + 1e-6 * np.eye(8)
    return means, covariances, np.array([first, 1 - first])


def same(found: oracle.Modes, wanted: oracle.Modes) -> None:
    for number, expected in zip(found, wanted, strict=True):
        np.testing.assert_allclose(number, expected, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("seed", range(10))
def test_mixed_modes_match_numpy(seed: int) -> None:
    mean, covariance = mixed(*modes_of(seed))
    wanted = oracle.mixed(modes_of(seed))
    np.testing.assert_allclose(mean, wanted[0], rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(covariance, wanted[1], rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("known", [False, True])
@pytest.mark.parametrize("seed", range(10))
def test_prediction_matches_numpy(seed: int, known: bool) -> None:
    rng = np.random.default_rng(seed)
    modes, dt, yaw = modes_of(seed), float(rng.uniform(0.01, 0.5)), rng.uniform(-3, 3)
    if seed % 2:
        modes[0][:, 7] = 0.0
    axis = np.array([np.sin(yaw), 0.0, np.cos(yaw)])
    found = predict(*modes, dt, ACCELERATION, YAW_ACCELERATION, axis if known else np.zeros(3))
    same(
        found, oracle.predicted(modes, dt, ACCELERATION, YAW_ACCELERATION, axis if known else None)
    )


@pytest.mark.parametrize("which", [(0, 1, 2, 6), (0, 1, 2), (3, 4, 5)])
@pytest.mark.parametrize("sigma", [1e-3, 0.1, 10.0])
@pytest.mark.parametrize("seed", range(6))
def test_update_matches_numpy(seed: int, sigma: float, which: tuple[int, ...]) -> None:
    rng = np.random.default_rng(seed)
    modes = modes_of(seed)
    measured = modes[0].mean(axis=0)[list(which)] + rng.normal(0.0, sigma, len(which))
    factor = rng.normal(0.0, sigma, (len(which), len(which)))
    noise = factor @ factor.T + 1e-6 * np.eye(len(which))
    same(
        update(*modes, np.array(which), measured, noise),
        oracle.updated(modes, np.array(which), measured, noise),
    )


def test_no_mode_becomes_impossible_after_a_surprise() -> None:
    modes = modes_of(0, 1e-3)
    modes[0][1] = 50.0
    _, _, probabilities = update(*modes, np.arange(3), modes[0][0, :3].copy(), 1e-6 * np.eye(3))
    np.testing.assert_allclose(probabilities.min(), 1e-3 / (1 + 1e-3))


@pytest.mark.parametrize("first", [0, 3])
@pytest.mark.parametrize("seed", range(6))
def test_squared_gap_matches_numpy(seed: int, first: int) -> None:
    rng = np.random.default_rng(seed)
    _, covariance = oracle.mixed(modes_of(seed))
    factor, gap = rng.normal(0.0, 0.3, (3, 3)), rng.normal(0.0, 1.0, 3)
    noise = factor @ factor.T
    part = covariance[first : first + 3, first : first + 3]
    wanted = gap @ np.linalg.solve(part + noise, gap)
    np.testing.assert_allclose(squared_gap(gap, covariance, first, noise), wanted, rtol=1e-7)


@pytest.mark.parametrize("seed", range(6))
def test_velocity_at_centre_matches_numpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mean, covariance = oracle.mixed(modes_of(seed))
    arm, lasting, doubt_m = rng.normal(0.0, 1.0, 3), rng.uniform(0, 1, 3), float(rng.uniform(0, 1))
    wanted = oracle.velocity_at_centre(mean, covariance, arm, np.diag(lasting), doubt_m)
    found = velocity_at_centre(mean, covariance, arm, np.diag(lasting), doubt_m)
    np.testing.assert_allclose(found[0], wanted[0], rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(found[1], wanted[1], rtol=1e-12, atol=1e-14)
