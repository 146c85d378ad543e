"""Random matrices for the kernels' tests."""

from __future__ import annotations

import numpy as np

from observer.geometry import Float64Array


def positive(rng: np.random.Generator, count: int, sigma: float) -> Float64Array:
    """(N, 3, 3) symmetric positive matrices."""
    factor = rng.normal(0.0, sigma, (count, 3, 3))
    return np.asarray(factor @ factor.transpose(0, 2, 1) + 0.1 * sigma**2 * np.eye(3))
