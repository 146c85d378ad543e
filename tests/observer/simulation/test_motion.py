"""Motions: poses, velocities and ramps in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.errors import ScenarioError
from observer.simulation.motion import Course, Leg, Oscillation, Parked, Ramp, Sway

STADIUM = [
    Leg(distance=2.0, speed=0.4),
    Leg(distance=math.pi * 0.5, angle=math.pi, speed=0.4),
    Leg(distance=2.0, speed=0.4),
    Leg(distance=math.pi * 0.5, angle=math.pi, speed=0.4),
]


def course(legs: list[Leg], after: str = "stay", heading: float = 0.3) -> Course:
    return Course(1.0, -0.5, heading, legs, after=after, acceleration=0.5, angular_acceleration=1.5)


@settings(max_examples=40)
@given(length=st.floats(0.05, 10), cruise=st.floats(0.05, 3), acceleration=st.floats(0.1, 5))
def test_a_ramp_from_rest_to_rest_covers_its_length_within_its_speed(
    length: float, cruise: float, acceleration: float
) -> None:
    ramp = Ramp.over(length, 0.0, cruise, 0.0, acceleration)
    distance, speed = ramp.distance_and_speed(ramp.duration)
    assert distance == pytest.approx(length, abs=1e-9)
    assert speed == pytest.approx(0, abs=1e-6)
    _, fastest = ramp.distance_and_speed(ramp.duration / 2)
    assert fastest <= cruise + 1e-9
    assert fastest == pytest.approx(min(cruise, math.sqrt(acceleration * length)), rel=1e-6)


def test_a_leg_too_short_to_brake_is_refused() -> None:
    with pytest.raises(ScenarioError, match="too short"):
        Ramp.over(0.01, 1.0, 1.0, 0.0, 0.5)


@pytest.mark.parametrize("after", ["stay", "repeat", "back"])
def test_velocities_are_the_derivative_of_positions(after: str) -> None:
    legs = [
        Leg(distance=0.8, speed=0.4),
        Leg(angle=1.2, rate=0.7),
        Leg(seconds=0.5),
        Leg(distance=1.1, angle=-0.9, speed=0.5),
        Leg(distance=-0.4, speed=0.3),
    ]
    motion = course(legs, after)
    h = 1e-6
    # Multiples of 0.0137 s avoid the joints of ramps, where the acceleration jumps.
    for k in range(1, 1500):
        t = 0.0137 * k
        before, now, later = motion.state(t - h), motion.state(t), motion.state(t + h)
        assert now.vx == pytest.approx((later.x - before.x) / (2 * h), abs=1e-5)
        assert now.vy == pytest.approx((later.y - before.y) / (2 * h), abs=1e-5)
        assert now.turn_rate == pytest.approx((later.heading - before.heading) / (2 * h), abs=1e-5)


def test_an_arc_is_a_circle() -> None:
    motion = Course(
        0, 0, 0, [Leg(distance=math.pi, angle=math.pi, speed=0.5)],
        after="stay", acceleration=0.5, angular_acceleration=1,
    )  # fmt: skip
    for k in range(20):
        s = motion.state(k * 0.3)
        assert math.hypot(s.x, s.y - 1) == pytest.approx(1, abs=1e-12)
    end = motion.state(100)
    assert (end.x, end.y, end.heading) == pytest.approx((0, 2, math.pi), abs=1e-12)
    assert (end.vx, end.vy, end.turn_rate) == (0, 0, 0)


def test_a_closed_course_repeats_without_drift_at_its_cruising_speed() -> None:
    motion = course(STADIUM, "repeat")
    assert motion.period == pytest.approx((4 + math.pi) / 0.4)
    for t in (0.0, 1.3, 7.7, 12.1):
        first, later = motion.state(t), motion.state(t + 1000 * motion.period)
        assert (later.x, later.y) == pytest.approx((first.x, first.y), abs=1e-6)
        assert math.hypot(first.vx, first.vy) == pytest.approx(0.4)


def test_an_open_course_repeats_from_where_it_ended() -> None:
    motion = Course(
        0, 0, 0, [Leg(distance=1, speed=0.5), Leg(angle=math.pi / 2, rate=1)],
        after="repeat", acceleration=0.5, angular_acceleration=2,
    )  # fmt: skip
    corners = [motion.state(k * motion.period) for k in range(5)]
    expected = [(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)]
    for corner, (x, y) in zip(corners, expected, strict=True):
        assert (corner.x, corner.y) == pytest.approx((x, y), abs=1e-9)


def test_back_drives_the_same_path_in_reverse() -> None:
    motion = course(STADIUM[:2], "back")
    for t in (0.2, 1.9, 5.0):
        there, back = motion.state(t), motion.state(2 * motion.period - t)
        assert (there.x, there.y, there.heading) == pytest.approx((back.x, back.y, back.heading))
        assert (there.vx, there.vy) == pytest.approx((-back.vx, -back.vy))


def test_the_commanded_speed_is_a_step_where_the_true_one_is_a_ramp() -> None:
    motion = course([Leg(distance=1.0, speed=0.5), Leg(seconds=2.0)])
    assert motion.commanded_speed(0.01) == 0.5
    s = motion.state(0.01)
    assert math.hypot(s.vx, s.vy) == pytest.approx(0.005)
    assert motion.commanded_speed(motion.period - 1.0) == 0


def test_the_reversed_motion_is_commanded_on_the_way_back() -> None:
    motion = course([Leg(distance=1.0, speed=0.5)], "back")
    # Not at the joints of ramps, where the command changes.
    for t in np.arange(0.005, motion.period, 0.01).tolist():
        assert motion.commanded_speed(motion.period + t) == motion.commanded_speed(t)
    # Back it goes from 0.5 to 0.3 m/s.
    motion = course([Leg(distance=1.0, speed=0.3), Leg(distance=1.0, speed=0.5)], "back")
    for t in np.arange(0.005, motion.period, 0.01).tolist():
        t += motion.period
        now, later = (math.hypot(s.vx, s.vy) for s in (motion.state(t), motion.state(t + 1e-4)))
        change = later - now
        # The speed always tends towards the command.
        if abs(change) > 1e-6:
            assert change * (motion.commanded_speed(t) - now) > 0
        else:
            assert motion.commanded_speed(t) == pytest.approx(now)
    assert motion.commanded_speed(motion.period + 0.01) == 0.5
    assert motion.commanded_speed(2 * motion.period - 0.01) == 0.0


def test_sway_and_parked() -> None:
    sway = Sway(1, 2, 0.5, Oscillation(0.3, 4.0), Oscillation(0.1, 3.0, 1.0), Oscillation(0.2, 5))
    h = 1e-6
    for t in (0.0, 0.7, 3.3):
        a, now, b = sway.state(t - h), sway.state(t), sway.state(t + h)
        assert (now.vx, now.vy) == pytest.approx(
            ((b.x - a.x) / (2 * h), (b.y - a.y) / (2 * h)), abs=1e-6
        )
        assert sway.commanded_speed(t) == pytest.approx(math.hypot(now.vx, now.vy))
    assert Parked(1, 2, 3).state(9.0) == Parked(1, 2, 3).state(0.0)
    assert Parked(1, 2, 3).commanded_speed(1.0) == 0
