"""Setting off with somebody at the robot: it waits until that person has left, not for a wall."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

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
Echo = Callable[[float], float | None]
WAITING = f"Waiting: sonar {BESIDE} detects something at the robot."


def errand(time: float, echo: float | None, speed_mps: float) -> Errand:
    quiet = [SonarReading(k, s.x, s.y, s.heading, None, time) for k, s in enumerate(SPEC.sonars)]
    quiet[BESIDE] = replace(quiet[BESIDE], range_m=echo)
    return Errand(
        Goal(1, 5.0, 0.0, 1e-3), time, 0.0, 0.0, 0.0, speed_mps, 0.0,
        SPEC.radius_m, SPEC.width_m, SPEC.length_m, tuple(quiet),
    )  # fmt: skip


def plans(echo: Echo, until: float, *, speed_mps: float = 0.0) -> list[Plan]:
    """Return the plan of every 0.1 s, with an echo beside the robot by time."""
    navigator = Navigator(GuardParameters(), NavigationParameters())
    made = []
    for k in range(1, round(10 * until) + 1):
        time = k / 10
        navigator.see(Sight(k, time, time, "real", Status.OK, (), True, (), FREE), np.zeros(3))
        made.append(navigator.plan(errand(time, echo(time), speed_mps), time))
    return made


def test_a_standing_robot_does_not_set_off_while_somebody_is_at_it() -> None:
    made = plans(lambda time: 0.05 if 0.95 < time < 1.45 else None, 2.5)
    waits = [each.reason == WAITING for each in made]
    assert not any(waits[:9])
    # Until half a second after the last echo, at 1.4 s.
    assert all(waits[9:18])
    assert not any(waits[19:])
    assert all(each.path == () for each in made[9:18])
    assert made[-1].speed_mps > 0.4


def test_a_wall_beside_the_robot_holds_it_up_for_three_seconds_only() -> None:
    made = plans(lambda _: 0.1, 5.0)
    waits = [each.reason == WAITING for each in made]
    assert all(waits[:30])
    assert not any(waits[31:])


def test_an_echo_farther_away_does_not_hold_the_robot_up() -> None:
    assert all(each.reason != WAITING for each in plans(lambda _: 0.3, 1.0))


def test_a_robot_that_drives_is_not_stopped_by_an_echo_beside_it() -> None:
    made = plans(lambda _: 0.1, 1.0, speed_mps=0.3)
    assert all(each.reason != WAITING for each in made)
    assert made[-1].speed_mps > 0.0
