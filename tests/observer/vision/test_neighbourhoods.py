"""Sums over neighbours and groups, against matrices and against a naive search."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.vision.neighbourhoods import false_alarms_per_test, grouped, summed

SEEDS = st.integers(0, 2**32 - 1)


def drawn(seed: int) -> tuple[np.random.Generator, int, np.ndarray]:
    """A random generator, a number of points, and some distinct pairs (P, 2) of them."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 40))
    pairs = np.sort(rng.integers(0, count, (int(rng.integers(0, 60)), 2)), axis=1)
    pairs = np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0).reshape(-1, 2)
    return rng, count, pairs


@given(SEEDS)
def test_sums_match_the_neighbour_matrix(seed: int) -> None:
    rng, count, pairs = drawn(seed)
    near = np.eye(count)
    near[pairs[:, 0], pairs[:, 1]] = near[pairs[:, 1], pairs[:, 0]] = 1
    first, second = rng.normal(size=(count, 2)), rng.normal(size=(count, 3))
    expected = near @ np.hstack([first, second])
    np.testing.assert_allclose(summed(pairs, [first, second]), expected, atol=1e-12)


@given(SEEDS)
def test_groups_are_connected_components(seed: int) -> None:
    rng, count, pairs = drawn(seed)
    chosen = rng.random(count) < 0.7
    group = grouped(pairs, chosen, 2)
    linked = {int(k): {int(k)} for k in np.flatnonzero(chosen)}
    for i, j in pairs.tolist():
        if i in linked and j in linked:
            union = linked[i] | linked[j]
            for k in union:
                linked[k] = union
    for k in range(count):
        if k in linked and len(linked[k]) >= 2:
            assert set(np.flatnonzero(group == group[k]).tolist()) == linked[k]
        else:
            assert group[k] == -1
    sizes = np.bincount(group[group >= 0])
    assert (np.diff(sizes) <= 0).all()


def test_points_judged_together_count_as_fewer_tests() -> None:
    ready = np.array([True] * 12 + [False] * 5)
    assert false_alarms_per_test(0.01, ready, np.full(17, 4.0)) == pytest.approx(0.01 / 3)
    assert false_alarms_per_test(0.01, ready & False, np.zeros(17)) == pytest.approx(0.01)
