"""Planted offsets are found, with an honest sigma, or refused."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.errors import NotObservable
from observer.geometry import Float64Array
from observer.truth.alignment.curves import SpeedCurve, between
from observer.truth.alignment.time_offset import TimeOffset, find_time_offset

from .conftest import to_source


def drive(t: Float64Array, seed: int) -> Float64Array:
    """Return a robot's speed, m/s: one-second ramps between speeds held for some seconds."""
    rng = np.random.default_rng(seed)
    knots, speeds = [-100.0], [0.0]
    now = rng.uniform(1, 3)
    while now < 80:
        knots += [now, now + 1]
        speeds += [speeds[-1], 0.0 if len(knots) % 4 == 1 else rng.uniform(0.2, 0.5)]
        now += 1 + rng.uniform(2, 5)
    return np.interp(t, knots, speeds)


def curves(
    offset: float,
    noise: float,
    seed: int,
    *,
    duration: float = 40.0,
    drift_ppm: float = 0.0,
    base: float = 0.0,
) -> tuple[SpeedCurve, SpeedCurve]:
    """Return the observed curve at 10 frames a second with noise, and truth at 100 Hz with gaps."""
    rng = np.random.default_rng(1000 + seed)
    seen_at = np.arange(0, duration, 0.1) + 0.05
    values = np.abs(drive(seen_at, seed) + rng.normal(0, noise, len(seen_at)))
    values[rng.random(len(values)) < 0.03] += 0.5
    own = np.arange(0, duration, 0.01) + rng.uniform(0, 0.01)
    source = own + 1e-6 * drift_ppm * (own - duration / 2)
    # Smoothed speeds have slowly varying errors.
    wander = np.convolve(rng.normal(0, 0.003, len(own)), np.ones(11) / 11, "same")
    true = drive(source, seed) + wander
    for start in rng.integers(0, len(own), 4):
        true[start : start + 60] = np.nan
    return SpeedCurve.of(seen_at, values, noise), SpeedCurve.of(own - offset + base, true, 0.003)


# Errors as in vision at 10 frames a second: one speed in thirty is wrong by 0.5 m/s.
@pytest.mark.parametrize(("noise", "worst_median"), [(0.02, 0.005), (0.05, 0.015)])
def test_planted_offsets_are_found_within_the_stated_sigma(
    noise: float, worst_median: float, record_property: Callable[[str, object], None]
) -> None:
    errors, within = [], []
    for seed in range(21):
        offset = (0.05, -0.12, 0.3)[seed % 3]
        seen, true = curves(offset, noise, seed, base=100.0 * seed)
        found = find_time_offset([(seen, true)], drift=False)
        error = found.offset_s - (offset - 100.0 * seed)
        errors.append(abs(error))
        within.append(abs(error) <= 2 * found.sigma_s)
        assert found.sigma_s < 0.04
        assert found.correlation > 0.8
    record_property("median_error_s", float(np.median(errors)))
    record_property("within_two_sigma", float(np.mean(within)))
    assert np.median(errors) <= worst_median
    assert np.mean(within) >= 0.9


def test_drift_is_found_over_a_long_overlap() -> None:
    seen, true = curves(0.3, 0.004, 4, duration=80.0, drift_ppm=150.0)
    found = find_time_offset([(seen, true)])
    assert found.drift_sigma_ppm is not None
    assert found.drift_sigma_ppm < 60
    assert abs(found.drift_ppm - 150) < 2.5 * found.drift_sigma_ppm
    assert found.drift_ppm > 2 * found.drift_sigma_ppm
    middle = to_source(found, np.array([found.reference_s]))[0]
    assert middle == pytest.approx(found.reference_s + 0.3, abs=0.005)


def test_short_overlaps_give_no_drift() -> None:
    found = find_time_offset([curves(0.3, 0.02, 4, duration=15.0, drift_ppm=50.0)])
    assert found.drift_ppm == 0
    assert found.drift_sigma_ppm is None


@settings(max_examples=50)
@given(st.floats(-1e5, 1e5), st.floats(-500, 500), st.lists(st.floats(-1e3, 1e3), min_size=1))
def test_clock_conversion_is_inverted_exactly(
    offset: float, drift: float, times: list[float]
) -> None:
    time = TimeOffset(offset, 0.001, 10.0, drift, None, 1.0, None, 60.0, 0.0, 100)
    t = np.array(times)
    np.testing.assert_allclose(time.to_truth(to_source(time, t)), t, atol=1e-8)


def test_constant_speed_is_refused() -> None:
    t = np.arange(0, 30, 0.1)
    rng = np.random.default_rng(0)
    seen = SpeedCurve.of(t, 0.4 + rng.normal(0, 0.02, len(t)), 0.02)
    true = SpeedCurve.of(np.arange(0, 30, 0.01), np.full(3000, 0.4), 0.003)
    with pytest.raises(NotObservable, match=r"constant within its noise.*start, stop or turn"):
        find_time_offset([(seen, true)])


def test_periodic_motion_is_refused_unless_a_search_range_is_given() -> None:
    t, own = np.arange(0, 40, 0.1), np.arange(0, 40, 0.01)
    seen = SpeedCurve.of(t, 0.3 + 0.2 * np.sin(2 * np.pi * t / 8), 0.02)
    true = SpeedCurve.of(own - 0.3, 0.3 + 0.2 * np.sin(2 * np.pi * own / 8), 0.003)
    with pytest.raises(NotObservable, match="periodic motion"):
        find_time_offset([(seen, true)])
    found = find_time_offset([(seen, true)], search=(-1, 1), drift=False)
    assert found.offset_s == pytest.approx(0.3, abs=0.002)


def test_motion_of_another_body_is_refused() -> None:
    seen, _ = curves(0, 0.02, 1)
    _, true = curves(0, 0.02, 7)
    with pytest.raises(NotObservable, match=r"do not agree|almost equally well|edge"):
        find_time_offset([(seen, true)], search=(-1, 1))


def test_too_short_overlap_is_refused() -> None:
    seen, true = curves(0.05, 0.02, 3, duration=3.0)
    with pytest.raises(NotObservable, match="too short"):
        find_time_offset([(seen, true)])


def test_nothing_is_interpolated_over_gaps() -> None:
    times = np.array([0.0, 1, 2, 3, 4, 20, 21])
    values = np.array([0.0, 1, np.nan, 3, 4, 20, 21])[:, None]
    found = between(times, values, np.array([-0.1, 0.5, 1, 1.5, 3, 3.5, 10, 20, 20.5, 21, 21.1]))
    expected = [np.nan, 0.5, 1, np.nan, 3, 3.5, np.nan, 20, 20.5, 21, np.nan]
    np.testing.assert_allclose(found[:, 0], expected)
