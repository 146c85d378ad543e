"""The quantiles agree with those of scipy.stats to the last digit."""

from __future__ import annotations

import math

import pytest
from scipy.stats import chi2

from observer.chi_square import log_share_above, quantile, upper_quantile


@pytest.mark.parametrize("df", [1, 2, 3])
@pytest.mark.parametrize("probability", [1e-12, 1e-3, 0.5, 0.95, 0.999])
def test_quantiles_match_scipy(probability: float, df: int) -> None:
    assert quantile(probability, df) == chi2.ppf(probability, df=df)
    assert upper_quantile(probability, df) == chi2.isf(probability, df=df)


def test_log_tail_probabilities_match_scipy() -> None:
    for value in (0.0, 0.1, 3.0, 100.0, 1000.0):
        assert log_share_above(value, 3) == pytest.approx(chi2.logsf(value, df=3), rel=1e-12)
    assert log_share_above(1e5, 3) == -math.inf
