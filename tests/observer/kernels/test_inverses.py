"""Inverses of small matrices against numpy's."""

from __future__ import annotations

import numpy as np
import pytest

from observer.kernels.inverses import inverse_3x3

from .oracles.inverses import inverse_3x3 as oracle


@pytest.mark.parametrize("seed", range(4))
def test_inverses_match_numpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    spread = rng.normal(0, 10.0 ** rng.uniform(-3, 3, (50, 1, 1)), (50, 3, 3))
    positive = spread @ spread.transpose(0, 2, 1)
    found = inverse_3x3(positive)
    np.testing.assert_allclose(found, oracle(positive), rtol=1e-9)
    identity = np.broadcast_to(np.eye(3), (50, 3, 3))
    scale = np.linalg.cond(positive)[:, None, None]
    np.testing.assert_array_less(np.abs(found @ positive - identity) / scale, 1e-12)
    np.testing.assert_array_equal(found, found.transpose(0, 2, 1))


def test_any_memory_layout_is_accepted() -> None:
    positive = np.broadcast_to(np.diag([1.0, 2.0, 4.0]), (3, 3, 3))
    np.testing.assert_allclose(inverse_3x3(positive[::2]), [np.diag([1, 0.5, 0.25])] * 2)


def test_singular_matrices_give_no_finite_values() -> None:
    assert not np.isfinite(inverse_3x3(np.zeros((2, 3, 3)))).any()
