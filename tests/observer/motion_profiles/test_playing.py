"""The velocity a programme wants at an instant: rounds, ramps, the way back and the gesture."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.errors import InputError
from observer.motion_profiles.gesture import (
    GESTURE_S,
    GESTURE_SPEED_MPS,
    PULSE_S,
    PULSE_STARTS,
    REST_S,
    gesture_speed,
)
from observer.motion_profiles.playing import duration_s, progress_at, velocity_at
from observer.motion_profiles.profile import MotionProfile, Step
from observer.rig.rig import Role

TICK_S = 0.01


def programme(*steps: Step, gesture: bool = False, **roles: tuple[Step, ...]) -> MotionProfile:
    return MotionProfile("test", "", "", {"obstacle": steps, **roles}, gesture)  # type: ignore[dict-item]


def pose_after(
    played: MotionProfile, role: Role = "obstacle", *, repeat: int = 1, reverse: bool = False
) -> tuple[float, float, float]:
    """Return x, y, yaw, integrated from the velocity in the middle of each tick."""
    x = y = yaw = 0.0
    ticks = round(duration_s(played, repeat) / TICK_S)
    for i in range(ticks):
        wanted = velocity_at(played, role, (i + 0.5) * TICK_S, repeat=repeat, reverse=reverse)
        assert wanted is not None
        speed, rate = wanted
        heading = yaw + rate * TICK_S / 2
        x += speed * TICK_S * math.cos(heading)
        y += speed * TICK_S * math.sin(heading)
        yaw += rate * TICK_S
    return x, y, yaw


def test_steps_hold_their_velocity_and_ramps_are_linear() -> None:
    played = programme(Step(2, 0.4, ramp=True), Step(1, 0.4, 0.5), Step(2, 0.0, 0.0, ramp=True))
    assert velocity_at(played, "obstacle", 0.0) == (0.0, 0.0)
    assert velocity_at(played, "obstacle", 1.0) == pytest.approx((0.2, 0.0))
    assert velocity_at(played, "obstacle", 2.5) == (0.4, 0.5)
    assert velocity_at(played, "obstacle", 4.0) == pytest.approx((0.2, 0.25))
    assert velocity_at(played, "obstacle", 4.999999) is not None
    assert velocity_at(played, "obstacle", 5.0) is None


def test_a_robot_is_still_before_the_start_and_while_only_the_other_drives() -> None:
    played = programme(Step(1, 0.3), observer=(Step(4, 0.1),))
    assert duration_s(played) == 4
    assert velocity_at(played, "obstacle", -0.1) == (0.0, 0.0)
    assert velocity_at(played, "obstacle", 2.0) == (0.0, 0.0)
    assert velocity_at(played, "observer", 3.9) == (0.1, 0.0)
    alone = programme(Step(1, 0.3))
    assert velocity_at(alone, "observer", 0.5) == (0.0, 0.0)
    assert velocity_at(alone, "observer", 1.5) is None


def test_a_non_finite_elapsed_time_ends_the_programme() -> None:
    assert velocity_at(programme(Step(1, 0.3)), "obstacle", math.nan) is None
    assert velocity_at(programme(Step(1, 0.3)), "obstacle", math.inf) is None


def test_rounds_repeat_and_the_gesture_is_played_once() -> None:
    played = programme(Step(1, 0.3), Step(1, -0.2), gesture=True)
    assert duration_s(played, 3) == GESTURE_S + 6
    assert velocity_at(played, "obstacle", 0.1, repeat=3) == (GESTURE_SPEED_MPS, 0.0)
    for round_number in (1, 2, 3):
        start = GESTURE_S + 2 * (round_number - 1)
        assert velocity_at(played, "obstacle", start + 0.5, repeat=3) == (0.3, 0.0)
        assert velocity_at(played, "obstacle", start + 1.5, repeat=3) == (-0.2, 0.0)
        told = progress_at(played, start + 0.5, 3)
        assert (told.phase, told.round, told.duration_s) == ("driving", round_number, GESTURE_S + 6)
    assert progress_at(played, 1.0, 3).phase == "gesture"
    over = progress_at(played, 1000.0, 3)
    assert (over.round, over.elapsed_s) == (3, over.duration_s)
    assert progress_at(played, -5.0).elapsed_s == 0


@pytest.mark.parametrize("repeat", [0, -1, 1001])
def test_an_invalid_number_of_rounds_is_refused(repeat: int) -> None:
    with pytest.raises(InputError, match="1 to 1000 times"):
        velocity_at(programme(Step(1, 0.3)), "obstacle", 0, repeat=repeat)


steps = st.lists(
    st.builds(
        Step,
        seconds=st.integers(1, 30).map(lambda n: n / 10),
        speed_mps=st.floats(-1, 1),
        turn_rate_radps=st.floats(-2, 2),
        ramp=st.booleans(),
    ),
    min_size=1,
    max_size=5,
).map(tuple)


@given(steps, steps)
def test_the_return_path_ends_at_the_start(mine: tuple[Step, ...], other: tuple[Step, ...]) -> None:
    played = programme(*mine, observer=other)
    for role in played.roles:
        there = pose_after(played, role)
        back = pose_after(played, role, reverse=True)
        # The way back, driven from the end of the way there, ends at the origin.
        x = there[0] + math.cos(there[2]) * back[0] - math.sin(there[2]) * back[1]
        y = there[1] + math.sin(there[2]) * back[0] + math.cos(there[2]) * back[1]
        assert (x, y, there[2] + back[2]) == pytest.approx((0, 0, 0), abs=1e-6)


def test_the_return_of_a_robot_that_finished_earlier_starts_later() -> None:
    played = programme(Step(1, 0.3), observer=(Step(4, 0.1),))
    assert velocity_at(played, "obstacle", 0.5, reverse=True) == (0.0, 0.0)
    assert velocity_at(played, "obstacle", 3.5, reverse=True) == (-0.3, 0.0)
    assert math.copysign(1, velocity_at(played, "obstacle", 0.5, reverse=True)[0]) == 1


# --- the gesture -----------------------------------------------------------------------------

SAMPLE_S = 0.01


def gesture_record(acceleration: float | None = None) -> np.ndarray:
    """Return (N,) m/s, every ``SAMPLE_S``, of a robot that accelerates slowly but stops at once."""
    wanted = [gesture_speed((i + 0.5) * SAMPLE_S) for i in range(round(GESTURE_S / SAMPLE_S))]
    if acceleration is None:
        return np.array(wanted)
    speed, driven = 0.0, []
    for each in wanted:
        step = acceleration * SAMPLE_S
        speed = each if abs(each) < abs(speed) else speed + max(-step, min(step, each - speed))
        driven.append(speed)
    return np.array(driven)


@pytest.mark.parametrize("acceleration", [None, 0.3])
@pytest.mark.parametrize("signed", [True, False])
def test_the_gestures_autocorrelation_has_one_sharp_peak(
    acceleration: float | None, signed: bool
) -> None:
    record = gesture_record(acceleration)
    record = record if signed else np.abs(record)
    correlation = np.correlate(record, record, mode="full") / float(record @ record)
    lags = (np.arange(len(correlation)) - len(record) + 1) * SAMPLE_S
    assert correlation[lags == 0] == pytest.approx(1)
    beside = np.abs(correlation[np.abs(lags) >= PULSE_S])
    assert beside.max() <= 0.2501
    # The peak is narrow too: correlation has halved within half a pulse.
    assert correlation[np.abs(lags) > PULSE_S / 2 + SAMPLE_S].max() <= 0.5


def test_evenly_spaced_pulses_have_a_second_peak() -> None:
    """Evenly spaced pulses have a second peak almost as high, so the check above can fail."""
    record = np.zeros(600)
    for start in (0, 150, 300, 450):
        record[start : start + 50] = 1
    correlation = np.correlate(record, record, mode="full") / float(record @ record)
    assert np.sort(correlation)[::-1][60] > 0.5


def test_the_gesture_ends_where_it_began_even_for_a_slow_robot() -> None:
    for record in (gesture_record(), gesture_record(0.3)):
        position = np.cumsum(record) * SAMPLE_S
        assert abs(position[-1]) < 1e-9
        assert position.min() > -1e-9
        assert position.max() <= GESTURE_SPEED_MPS * PULSE_S + 1e-9
    assert 4 <= GESTURE_S <= 6
    assert not gesture_record()[-round(REST_S / SAMPLE_S) :].any()
    differences = [b - a for i, a in enumerate(PULSE_STARTS) for b in PULSE_STARTS[i + 1 :]]
    assert len(set(differences)) == len(differences)
    assert 1 not in differences


def test_the_gesture_finds_the_offset_of_a_noisy_clock() -> None:
    """Two records of 15 Hz with 0.05 m/s of noise, 0.4 s apart, within half a sample."""
    rng = np.random.default_rng(4)
    rate, offset = 15.0, 0.4
    times = np.arange(0, 12, 1 / rate)
    one = np.array([gesture_speed(t - 2) for t in times]) + rng.normal(0, 0.05, len(times))
    other = np.array([gesture_speed(t - 2 - offset) for t in times])
    other += rng.normal(0, 0.05, len(times))
    correlation = np.correlate(other, one, mode="full")
    found = (int(correlation.argmax()) - len(times) + 1) / rate
    assert abs(found - offset) <= 0.5 / rate + 1e-9
