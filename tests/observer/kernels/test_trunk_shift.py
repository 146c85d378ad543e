"""The kernel for how far points on a trunk went, against the same by numpy."""

from __future__ import annotations

import numpy as np
import pytest

from observer.kernels.trunk_shift import trunk_shift

from .oracles import trunk_shift as oracle


@pytest.mark.parametrize("count", [1, 2, 3, 4, 9, 40])
@pytest.mark.parametrize("seed", range(12))
def test_the_trunk_shift_matches_numpy(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    ahead = rng.normal(0.0, 1.0, 3)
    ahead /= np.linalg.norm(ahead)
    origin = rng.normal(0.0, 3.0, 3)
    number = rng.permutation(2 * count)[:count]
    before = rng.permutation(2 * count)[: int(rng.integers(0, 2 * count + 1))]
    offset = rng.normal(0.0, 0.3, (2 * count, 3))
    # Some are on an arm, far off.
    swing = np.where(rng.random(count) < 0.2, 0.5, 0.0)[:, None]
    place = origin + offset[number] + (0.03 + swing + rng.normal(0, 0.02, (count, 1))) * ahead
    factor = rng.normal(0.0, 50.0, (count, 3, 3))
    arguments = (
        number, place, factor @ factor.transpose(0, 2, 1) + 10 * np.eye(3), origin, ahead,
        before, offset[before], rng.uniform(1e-4, 1e-3, len(before)), 3,
    )  # fmt: skip
    variance, which, moved, moved_variance = trunk_shift(*arguments)
    wanted = oracle.trunk_shift(*arguments)
    np.testing.assert_allclose(variance, wanted[0], rtol=1e-6)
    np.testing.assert_array_equal(which, wanted[1])
    np.testing.assert_allclose([moved, moved_variance], wanted[2:], rtol=1e-6, atol=1e-9)


def test_the_variance_is_infinite_without_points() -> None:
    none, empty = np.zeros(0, np.int64), np.zeros((0, 3))
    variance, which, _, moved_variance = trunk_shift(
        none, empty, np.zeros((0, 3, 3)), np.zeros(3), np.array([0.0, 0.0, 1.0]),
        none, empty, np.zeros(0), 3,
    )  # fmt: skip
    assert len(variance) == len(which) == 0
    assert np.isinf(moved_variance)
