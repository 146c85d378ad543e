"""The ramp: rising is limited, falling is not, and no component ever exceeds what is wanted."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.drive.ramp import ramped

numbers = st.floats(-2, 2, allow_nan=False, width=32)


def test_speed_rises_linearly_and_falls_immediately() -> None:
    velocity, speeds = (0.0, 0.0), []
    for _ in range(60):
        velocity = ramped(velocity, (0.3, 0.0), 0.3, 1.5, 0.02)
        speeds.append(velocity[0])
    assert speeds[:3] == pytest.approx([0.006, 0.012, 0.018])
    assert speeds[48:51] == pytest.approx([0.294, 0.3, 0.3])
    assert ramped((0.3, 0.0), (0.1, 0.0), 0.3, 1.5, 0.02) == (0.1, 0.0)
    assert ramped((0.3, 0.5), (0.0, 0.0), 0.3, 1.5, 0.02) == (0.0, 0.0)


def test_reversing_starts_from_rest() -> None:
    assert ramped((0.3, 0.0), (-0.3, 0.0), 0.3, 1.5, 0.02) == pytest.approx((-0.006, 0.0))


def test_a_start_from_rest_stays_on_the_wanted_arc() -> None:
    velocity = (0.0, 0.0)
    for _ in range(200):
        velocity = ramped(velocity, (0.5, 1.0), 0.3, 1.5, 0.02)
        assert velocity[1] == pytest.approx(2 * velocity[0])
    assert velocity == pytest.approx((0.5, 1.0))


def test_turning_while_driving_does_not_brake() -> None:
    speed, turn = ramped((0.3, 0.0), (0.3, 0.5), 0.3, 1.5, 0.02)
    assert (speed, turn) == pytest.approx((0.3, 0.03))


@given(numbers, numbers, numbers, numbers, st.floats(0, 0.04))
def test_no_component_exceeds_its_target_or_rises_too_fast(
    v: float, w: float, wanted_v: float, wanted_w: float, dt: float
) -> None:
    result = ramped((v, w), (wanted_v, wanted_w), 0.3, 1.5, dt)
    for part, before, wanted, most in zip(
        result, (v, w), (wanted_v, wanted_w), (0.3, 1.5), strict=True
    ):
        assert abs(part) <= abs(wanted)
        assert part * wanted >= 0
        assert abs(part) <= abs(before) + most * dt + 1e-9
