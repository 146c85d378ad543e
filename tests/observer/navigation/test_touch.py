"""Setting off with somebody at the robot: it waits until that person has left, not for a wall."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pytest

from observer.guard.parameters import GuardParameters
from observer.guard.sight import FreeScan, Sight
from observer.navigation.errand import Errand, Goal
from observer.navigation.navigator import Navigator
from observer.navigation.parameters import NavigationParameters
from observer.navigation.plan import Plan
from observer.robots.contract import SonarReading
from observer.robots.models import robot_spec
from observer.types import Status

SPEC = robot_spec("p3dx-sh")
BEARINGS = tuple(np.radians(np.arange(-30.0, 30.1, 3.0)).tolist())
FREE = FreeScan(BEARINGS, (None,) * 21, (0.3,) * 21, (5.0,) * 21)
# Points straight to the right and lies 0.07 m within the outline.
BESIDE = 7
AHEAD = 3
# Every sonar of a Pioneer is read once in this time.
CYCLE_S = 0.32
Echo = Callable[[float], float | None]
WAITING = f"Waiting: sonar {BESIDE} detects something at the robot."
WAITING_AHEAD = f"Waiting: sonar {AHEAD} detects something at the robot."


def errand(time: float, echoes: Mapping[int, Echo], received: float, speed_mps: float) -> Errand:
    sonars = tuple(
        SonarReading(k, s.x, s.y, s.heading, echoes[k](received) if k in echoes else None, received)
        for k, s in enumerate(SPEC.sonars)
    )
    return Errand(
        Goal(1, 5.0, 0.0, 1e-3), time, 0.0, 0.0, 0.0, speed_mps, 0.0,
        SPEC.radius_m, SPEC.width_m, SPEC.length_m, sonars,
    )  # fmt: skip


def plans(
    echoes: Mapping[int, Echo], until: float, *, drives_until: float = 0.0, cycle_s: float = 0.1
) -> list[Plan]:
    """Return the plan of every 0.1 s, with the echoes of some sonars by time.

    The robot drives at first, until a time; the sonars are read once in every cycle.
    """
    navigator = Navigator(GuardParameters(), NavigationParameters())
    made = []
    for k in range(1, round(10 * until) + 1):
        time = k / 10
        received = min(int(time / cycle_s + 1e-6) * cycle_s, time)
        speed_mps = 0.3 if time <= drives_until else 0.0
        navigator.see(Sight(k, time, time, "real", Status.OK, (), True, (), FREE), np.zeros(3))
        made.append(navigator.plan(errand(time, echoes, received, speed_mps), time))
    return made


def wall(_: float) -> float:
    return 0.05


def somebody(time: float) -> float | None:
    return 0.05 if 9.95 < time < 11.05 else None


def test_a_standing_robot_does_not_set_off_while_somebody_is_at_it() -> None:
    made = plans({BESIDE: lambda time: 0.05 if 0.95 < time < 1.45 else None}, 2.5)
    waits = [each.reason == WAITING for each in made]
    assert not any(waits[:9])
    # Until half a second after the last echo, at 1.4 s.
    assert all(waits[9:18])
    assert not any(waits[19:])
    assert all(each.path == () for each in made[9:18])
    assert made[-1].speed_mps > 0.4


def test_a_wall_beside_the_robot_holds_it_up_for_three_seconds_only() -> None:
    made = plans({BESIDE: lambda _: 0.1}, 5.0)
    waits = [each.reason == WAITING for each in made]
    assert all(waits[:30])
    assert not any(waits[31:])


@pytest.mark.parametrize("drives_until", [0.0, 9.0])
def test_a_wall_at_one_sonar_does_not_hide_somebody_at_another(drives_until: float) -> None:
    made = plans({BESIDE: wall, AHEAD: somebody}, 12.0, drives_until=drives_until)
    waits = [each.reason == WAITING_AHEAD for each in made]
    assert not any(each.reason == WAITING for each in made[31:])
    assert not any(waits[:99])
    # Until half a second after the last echo, at 11 s.
    assert all(waits[99:114])
    assert not any(waits[115:])


def test_a_wall_whose_echo_is_missing_every_second_time_holds_the_robot_up_once() -> None:
    made = plans(
        {BESIDE: lambda time: 0.05 if round(time / CYCLE_S) % 2 else None}, 20.0, cycle_s=CYCLE_S
    )
    waits = [each.reason == WAITING for each in made]
    # From the first reading, at 0.32 s.
    assert all(waits[3:8])
    assert not any(waits[34:])


@pytest.mark.parametrize("seed", range(2))
def test_a_wall_whose_echo_is_missing_at_times_holds_the_robot_up_once(seed: int) -> None:
    heard = np.random.default_rng(seed).random(70) >= 0.1
    made = plans(
        {BESIDE: lambda time: 0.05 if heard[round(time / CYCLE_S)] else None},
        20.0,
        cycle_s=CYCLE_S,
    )
    waits = [each.reason == WAITING for each in made]
    assert any(waits[:10])
    assert not any(waits[34:])


def test_somebody_who_comes_after_a_silence_is_waited_for_again() -> None:
    made = plans({BESIDE: lambda time: 0.05 if time < 4.05 or time > 5.75 else None}, 7.0)
    waits = [each.reason == WAITING for each in made]
    assert not any(waits[31:57])
    assert all(waits[57:])


def test_an_echo_farther_away_does_not_hold_the_robot_up() -> None:
    assert all(each.reason != WAITING for each in plans({BESIDE: lambda _: 0.3}, 1.0))


def test_a_robot_that_drives_is_not_stopped_by_an_echo_beside_it() -> None:
    made = plans({BESIDE: lambda _: 0.1}, 1.0, drives_until=1.0)
    assert all(each.reason != WAITING for each in made)
    assert made[-1].speed_mps > 0.0
