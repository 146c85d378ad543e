"""Coverage of predictions, with the truth drawn from the predictions."""

from __future__ import annotations

import numpy as np
import pytest

from observer.navigation.calibration import coverage, ranks
from observer.navigation.futures import Futures

COUNT = 600
TIMES = np.array([1.0, 2.0])


def predicted(stretch: float = 1.0) -> Futures:
    """Return futures that go on or turn off, 3 : 1, with the spread overstated by ``stretch``."""
    mean = np.zeros((COUNT, 2, 2, 2))
    mean[:, 0, :, 0] = TIMES
    mean[:, 1, :, 1] = TIMES
    sigma = np.broadcast_to(stretch * np.array([0.2, 0.5]), (COUNT, 2, 2))
    weight = np.tile([0.75, 0.25], (COUNT, 1))
    return Futures(tuple(range(COUNT)), np.full(COUNT, 0.3), TIMES, mean, sigma, weight)


def came_to(instant: int) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    rng = np.random.default_rng(5)
    people = predicted()
    which = (rng.random(COUNT) > 0.75).astype(int)
    rows = np.arange(COUNT)
    noise = rng.normal(size=(COUNT, 2)) * people.sigma[rows, which, instant][:, None]
    return people.mean[rows, which, instant] + noise


@pytest.mark.parametrize("instant", [0, 1])
def test_a_calibrated_prediction_has_its_nominal_coverage(instant: int) -> None:
    ranked = ranks(predicted(), instant, came_to(instant), np.random.default_rng(1))
    assert ranked.shape == (COUNT,)
    # 600 draws: one standard deviation is 0.9 % here and 2 % at the median.
    assert coverage(ranked) == pytest.approx(0.95, abs=0.03)
    assert coverage(ranked, 0.5) == pytest.approx(0.5, abs=0.07)


@pytest.mark.parametrize(("stretch", "low", "high"), [(0.5, 0.4, 0.7), (3.0, 0.99, 1.0)])
def test_too_small_or_too_large_a_spread_shows_in_the_coverage(
    stretch: float, low: float, high: float
) -> None:
    ranked = ranks(predicted(stretch), 1, came_to(1), np.random.default_rng(1))
    share = coverage(ranked)
    assert share is not None
    assert low <= share <= high


def test_no_ranks_give_no_coverage() -> None:
    assert coverage([]) is None
