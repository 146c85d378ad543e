"""Calibration of predictions: how often people end up where they were predicted to be.

The region that should contain a person with 95 % probability is the smallest such one: that of
highest density (Hyndman, Computing and graphing highest density regions, The American Statistician
50, 1996). Its border has no closed form for a mixture, so its probability is estimated by sampling.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from observer.geometry import Float64Array
from observer.navigation.futures import Futures

REGION: Final = 0.95
_SAMPLES: Final = 400
_TINY: Final = 1e-300


def ranks(
    people: Futures, instant: int, places: Float64Array, rng: np.random.Generator
) -> Float64Array:
    """(N,) probability mass where the density is higher than at each person's true position.

    Uniform from 0 to 1 for a calibrated prediction: a person was within its 95 % region where
    this is at most 0.95.

    Args:
        instant: index of the predicted instant. places: (N, 2) of the people at that instant,
            metres in the frame of the prediction.
    """
    mean, sigma = people.mean[:, :, instant], people.sigma[:, :, instant]
    count = len(people)
    # Draw the manoeuvre of each sample, then its place.
    steps = people.weight.cumsum(axis=1)[:, None]
    drawn = (rng.random((count, _SAMPLES, 1)) > steps / steps[..., -1:]).sum(axis=2)
    row = np.arange(count)[:, None]
    noise = rng.normal(size=(count, _SAMPLES, 2))
    samples = mean[row, drawn] + noise * sigma[row, drawn][..., None]
    there = _log_density(samples, mean, sigma, people.weight)
    own = _log_density(places[:, None], mean, sigma, people.weight)
    return np.asarray((there > own).mean(axis=1))


def coverage(ranked: Sequence[float] | Float64Array, region: float = REGION) -> float | None:
    """Return the share of people within their region; None without people."""
    values = np.asarray(ranked)
    return float((values <= region).mean()) if len(values) else None


def _log_density(
    places: Float64Array, mean: Float64Array, sigma: Float64Array, weight: Float64Array
) -> Float64Array:
    """(N, S) log density of mixtures (N, M) at places (N, S, 2)."""
    squared = ((places[:, :, None] - mean[:, None]) ** 2).sum(axis=3)
    variance = sigma[:, None] ** 2
    terms = weight[:, None] * np.exp(-squared / (2 * variance)) / (2 * np.pi * variance)
    return np.asarray(np.log(np.maximum(terms.sum(axis=2), _TINY)))
