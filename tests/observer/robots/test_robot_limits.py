"""The smallest of all limits, and velocities within them."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.robots.arcos import PacketParser, decode_command
from observer.robots.config_reply import ConfigReply
from observer.robots.contract import RobotLimits
from observer.robots.models import robot_spec
from observer.robots.robot_limits import limit_commands, limits_in_force, setpoint_within

P3DX = robot_spec("p3dx-sh")
LIMITS = RobotLimits(0.75, math.radians(100), 0.3, math.radians(50))


def test_without_reported_limits_those_of_the_model_apply() -> None:
    limits = limits_in_force(P3DX, ConfigReply(speed_top=0, turn_rate_max=0))
    assert limits.speed_mps == 2.2
    assert limits.turn_rate_radps == pytest.approx(math.radians(500))
    assert limits.acceleration_mps2 == P3DX.acceleration_max_mps2


def test_the_smallest_limit_applies_whatever_its_source() -> None:
    config = ConfigReply(
        speed_top=1500, speed_max=5000, turn_rate_top=360, turn_rate_max=120,
        acceleration_top=1000, turn_acceleration_top=5000,
    )  # fmt: skip
    limits = limits_in_force(P3DX, config)
    assert limits.speed_mps == 1.5
    assert limits.turn_rate_radps == pytest.approx(math.radians(120))
    assert limits.acceleration_mps2 == 1.0
    assert limits.turn_acceleration_radps2 == P3DX.turn_acceleration_max_radps2


def test_limit_commands_set_speeds_accelerations_and_decelerations() -> None:
    told = [decode_command(each) for each in PacketParser().feed(b"".join(limit_commands(LIMITS)))]
    assert [(each.number, each.argument) for each in told] == [
        (6, 750), (10, 100), (5, 300), (5, -300), (23, 50), (23, -50),
    ]  # fmt: skip


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_non_finite_velocity_becomes_zero(bad: float) -> None:
    assert setpoint_within(LIMITS, bad, 0.1) == (0, 0)
    assert setpoint_within(LIMITS, 0.1, bad) == (0, 0)


@given(st.floats(allow_nan=False, allow_infinity=False), st.floats(-1e6, 1e6))
def test_no_velocity_exceeds_the_limits_or_16_bits(speed: float, turn_rate: float) -> None:
    for limits in (LIMITS, RobotLimits(1e9, 1e9, 1.0, 1.0)):
        mmps, degps = setpoint_within(limits, speed, turn_rate)
        assert abs(mmps) <= min(limits.speed_mps * 1000, 32767)
        assert abs(degps) <= min(math.degrees(limits.turn_rate_radps) + 1e-6, 32767)
        if abs(speed) < 0.7:
            assert mmps == pytest.approx(speed * 1000, abs=0.5)
