"""Brightness that oscillates is reported; brightness that settles or drifts is not."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.vision.flicker import flicker_reason


def levels(brightness: object) -> list[float]:
    return [float(level) for level in np.log(np.asarray(brightness))]


@pytest.mark.parametrize("rate_hz", [10, 15, 30, 60])
@pytest.mark.parametrize("amplitude", [0.15, 0.4])
@given(phase=st.floats(0, math.tau))
def test_flicker_is_reported_at_any_rate(rate_hz: int, amplitude: float, phase: float) -> None:
    time = np.arange(rate_hz + 1) / rate_hz
    reason = flicker_reason(levels(100 * (1 + amplitude * np.sin(math.tau * 2.5 * time + phase))))
    assert reason is not None
    assert "flickers" in reason


@given(
    begin=st.floats(20, 200),
    end=st.floats(20, 200),
    time_s=st.floats(0.05, 2.0),
    seed=st.integers(0, 99),
)
def test_settling_and_grain_are_not_flicker(
    begin: float, end: float, time_s: float, seed: int
) -> None:
    time = np.arange(16) / 15
    grain = np.random.default_rng(seed).normal(0, 0.01, 16)
    settling = end + (begin - end) * np.exp(-time / time_s)
    assert flicker_reason(levels(settling * (1 + grain))) is None


def test_single_overshoot_is_not_flicker() -> None:
    assert flicker_reason(levels([100, 140, 180, 150, 120, 110, 120, 125])) is None
    assert flicker_reason(levels([100])) is None
