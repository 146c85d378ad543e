"""A server's clock against ours: offset and drift from timestamps and arrivals alone."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.truth.live.clock import ClockFit, ClockFitter, lower_line

from .arrivals import arrivals


def fitted(stamps: np.ndarray, received: np.ndarray) -> ClockFit:
    fitter = ClockFitter()
    for each in zip(stamps.tolist(), received.tolist(), strict=True):
        fitter.add(*each)
    fit = fitter.fit()
    assert fit is not None
    return fit


@pytest.mark.parametrize(
    ("planted", "stamped_to_s"), [(100.0, 0.0), (-100.0, 0.0), (0.0, 0.0), (100.0, 0.001)]
)
def test_planted_drift_is_found_within_20_ppm_over_60_s(
    planted: float, stamped_to_s: float
) -> None:
    worst_ppm = worst_s = worst_sigma_s = 0.0
    for seed in range(25):
        stamps, received = arrivals(seed, 60.0, drift_ppm=planted, stamped_to_s=stamped_to_s)
        fit = fitted(stamps, received)
        assert fit.drift_ppm is not None
        # The server runs fast, so host minus server decreases.
        worst_ppm = max(worst_ppm, abs(fit.drift_ppm + planted))
        sent = 1000.0 + np.arange(len(stamps)) / 100
        exact = sent + 1.7e9 + planted * 1e-6 * (sent - 1000)
        errors = np.array([fit.to_host(each) for each in exact.tolist()]) - sent - 4e-4
        worst_s = max(worst_s, float(np.abs(errors).max()))
        worst_sigma_s = max(worst_sigma_s, fit.sigma_s)
    sys.stdout.write(
        f"drift {planted:+.0f} ppm over 60 s, stamps to {stamped_to_s * 1e3:g} ms, 25 seeds: at "
        f"most {worst_ppm:.2f} ppm and {worst_s * 1e3:.2f} ms from the truth, sigma at most "
        f"{worst_sigma_s * 1e3:.2f} ms\n"
    )
    assert worst_ppm < 20
    assert worst_s < 1e-3
    assert worst_sigma_s < 1e-3


@given(
    st.integers(0, 100),
    st.sampled_from([2.5, 8.0, 60.0]),
    st.floats(0, 1),
    st.floats(1e-3, 1e3),
    st.floats(-200, 200),
)
def test_one_impossible_arrival_does_not_skew_the_clock(
    seed: int, duration_s: float, where: float, early_s: float, drift_ppm: float
) -> None:
    stamps, received = arrivals(seed, duration_s, drift_ppm=drift_ppm)
    expected = fitted(stamps, received)
    stamps[int(where * (len(stamps) - 1))] += early_s
    fit = fitted(stamps, received)
    for each in (stamps[0], stamps[-2]):
        assert fit.to_host(each) == pytest.approx(expected.to_host(each), abs=1.5e-3)
    if duration_s == 60.0:
        assert fit.sigma_s < 1e-3


def test_drift_is_not_estimated_before_ten_seconds() -> None:
    stamps, received = arrivals(1, 8.0, drift_ppm=100.0)
    fit = fitted(stamps, received)
    assert fit.drift_ppm is None
    assert fit.to_host(float(stamps[-1])) == pytest.approx(1008 - 0.01 + 4e-4, abs=2e-3)
    assert ClockFitter().fit() is None


def test_samples_older_than_the_window_are_dropped() -> None:
    fitter = ClockFitter(window_s=20.0)
    for each in zip(*map(np.ndarray.tolist, arrivals(1, 40.0, offset_s=5.0)), strict=True):
        fitter.add(*each)
    for each in zip(
        *map(np.ndarray.tolist, arrivals(2, 25.0, offset_s=4.99, started=1040.0)), strict=True
    ):
        fitter.add(*each)
    fit = fitter.fit()
    assert fit is not None
    assert fit.to_host(1060 + 4.99) == pytest.approx(1060, abs=2e-3)
    assert fit.span_s <= 20.2


_points = st.lists(
    st.tuples(st.integers(-1000, 1000), st.integers(-1000, 1000)), min_size=2, max_size=60
).filter(lambda points: len({x for x, _ in points}) > 1)


@given(_points, st.floats(-1, 1), st.floats(-2000, 2000))
def test_no_line_below_all_points_is_closer_to_them(
    points: list[tuple[int, int]], slope: float, height: float
) -> None:
    x, y = np.array(points, float).T
    at_mean, best = lower_line(x, y)
    assert (at_mean + best * (x - x.mean()) <= y + 1e-6).all()
    # Any other line, lowered until it is below all points.
    other = height + slope * (x - x.mean())
    other += (y - other).min()
    assert np.sum(y - at_mean - best * (x - x.mean())) <= np.sum(y - other) + 1e-6
