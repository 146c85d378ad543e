"""The kernels for membership in bodies against the same formulas by numpy."""

from __future__ import annotations

import numpy as np
import pytest

from observer.kernels.membership import against_rest, moves_along, place_on_body

from .matrices import positive
from .oracles import membership as oracle


@pytest.mark.parametrize("instants", [0, 1, 16])
@pytest.mark.parametrize("count", [0, 1, 30])
@pytest.mark.parametrize("seed", range(6))
def test_point_comparison_matches_numpy(seed: int, count: int, instants: int) -> None:
    rng = np.random.default_rng(seed)
    state = rng.normal(0.0, 0.5, 8)
    if seed == 0:
        state[3:6] = 0.0
    velocity = state[3:6] * rng.integers(0, 2, (count, 1)) + rng.normal(0.0, 0.1, (count, 3))
    arguments = (
        velocity, positive(rng, count, 10.0), positive(rng, count, 0.01),
        rng.uniform(0.1, 2.0, count), rng.normal(0.0, 2.0, (count, 3)), state,
        np.sort(rng.uniform(0.0, 3.0, instants))[::-1].copy(),
        rng.normal(0.0, 0.5, (instants, 4)),
    )  # fmt: skip
    for found, wanted in zip(
        against_rest(*arguments), oracle.against_rest(*arguments), strict=True
    ):
        np.testing.assert_allclose(found, wanted, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("seed", range(10))
def test_single_comparison_matches_numpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    velocity, gap = rng.normal(0.0, 0.5, (2, 3))
    body_cov, rest_cov = positive(rng, 2, 0.2)
    found = moves_along(velocity, gap, body_cov, rest_cov)
    wanted = oracle.moves_along(velocity[None], gap[None], body_cov[None], rest_cov[None])
    np.testing.assert_allclose(found, np.ravel(wanted), rtol=1e-9)


@pytest.mark.parametrize("rate", [0.0, 0.8])
@pytest.mark.parametrize("count", [0, 1, 20])
@pytest.mark.parametrize("seed", range(4))
def test_point_placement_matches_numpy(seed: int, count: int, rate: float) -> None:
    rng = np.random.default_rng(seed)
    state = rng.normal(0.0, 1.0, 8)
    state[7] = rate
    a0 = positive(rng, count, 30.0)
    age = rng.uniform(0.0, 2.0, count)
    arguments = (
        rng.normal(0.0, 2.0, (count, 3)), a0, -a0 * age[:, None, None],
        a0 * age[:, None, None] ** 2, rng.normal(0.0, 10.0, (count, 3)), state,
        rng.uniform(0.0, 0.5, count), age**2,
    )  # fmt: skip
    for found, wanted in zip(
        place_on_body(*arguments), oracle.place_on_body(*arguments), strict=True
    ):
        np.testing.assert_allclose(found, wanted, rtol=1e-7, atol=1e-8)
