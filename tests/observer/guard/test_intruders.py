"""Intruders, distinguished from things that the robot itself approaches."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest

from observer.guard.dead_reckoning import DeadReckoning
from observer.guard.guard import Guard
from observer.guard.intruders import SonarWatch
from observer.guard.outline import Outline as BodyOutline
from observer.guard.parameters import GuardParameters
from observer.guard.sight import FreeScan, SeenObstacle, Sight
from observer.robots.contract import SonarReading
from observer.robots.models import robot_spec
from observer.simulation.motion import PlanarState
from observer.simulation.robots.floor import Outline, Surroundings
from observer.simulation.robots.sonar import sonar_range
from observer.types import Status

P = GuardParameters()
AMIGO = robot_spec("amigo-sh")
# The left and the right sonar.
LEFT, RIGHT = 0, 5
EVERY_S = 0.3


def predictions(*ranges: float | None, index: int = LEFT) -> list[tuple[int, list[SeenObstacle]]]:
    """Return the approaching objects reported for these readings of a standing robot."""
    watch, past, pose = SonarWatch(), DeadReckoning(), AMIGO.sonars[index]
    now = 10.0
    for echo in ranges:
        for k in (1, 2, 3):
            past.advance(now + k * EVERY_S / 3, 0.0, 0.0)
        now += EVERY_S
        watch.listen([SonarReading(index, pose.x, pose.y, pose.heading, echo, now)], now, past, P)
    return watch.coming(now, past, P)


@pytest.mark.parametrize("index", [LEFT, RIGHT])
def test_an_approaching_object_is_predicted(index: int) -> None:
    ((number, places),) = predictions(1.5, 1.5, 1.35, 1.2, index=index)
    assert number == index
    sign = 1 if index == LEFT else -1
    middle = places[2]
    # 0.15 m in 0.3 s.
    assert (middle.vx, middle.vy) == pytest.approx((0.0, -0.5 * sign), abs=0.02)
    assert middle.y == pytest.approx(sign * (AMIGO.sonars[LEFT].y + 1.2), abs=0.1)
    assert middle.velocity_sigma_mps is not None
    assert middle.velocity_sigma_mps > 0.01
    # It may be anywhere across the cone.
    assert max(p.x for p in places) - min(p.x for p in places) > 0.3


@pytest.mark.parametrize(
    "ranges",
    [
        (1.0, 1.0, 1.0, 1.0),
        (1.0, 1.01, 0.99, 1.0, 0.985),
        (0.8, 0.95, 1.1, 1.3),
        # Something steps in suddenly and stands.
        (None, None, 0.6, 0.6, 0.6),
        # An outlier, and a missing reading.
        (1.5, 1.5, 0.3, 1.5, 1.5),
        (1.5, 1.5, 0.3),
        (1.0, 1.0, None, 1.0, 1.0),
        # It came, and now stands.
        (1.5, 1.5, 1.3, 1.1, 1.1),
    ],
)
def test_static_receding_or_erratic_echoes_are_not_intruders(
    ranges: tuple[float | None, ...],
) -> None:
    assert predictions(*ranges) == []


def drive_past(around: Surroundings, speed: float, turn: float = 0.0, seconds: float = 6.0) -> int:
    """Count the noisy readings of a static world after which something seems to approach."""
    watch, past, rng = SonarWatch(), DeadReckoning(), np.random.default_rng(4)
    x = y = yaw = 0.0
    count, sonars = 0, {}
    for k in range(round(seconds / 0.04)):
        now = 10 + 0.04 * k
        past.advance(now, speed, turn)
        index = k % 8
        pose = AMIGO.sonars[index]
        state = PlanarState(x, y, yaw, 0.0, 0.0, 0.0)
        echo = sonar_range(around.edges(), state, pose)
        echo = None if echo is None else round(echo + rng.normal(0, 0.01), 3)
        sonars[index] = SonarReading(index, pose.x, pose.y, pose.heading, echo, now)
        watch.listen(list(sonars.values()), now, past, P)
        count += bool(watch.coming(now, past, P))
        middle = yaw + turn * 0.02
        x, y = x + speed * 0.04 * math.cos(middle), y + speed * 0.04 * math.sin(middle)
        yaw += turn * 0.04
    return count


def _frame(x: float) -> tuple[Outline, Outline]:
    return Outline.of_box(x, 1.5, 0.0, 0.12, 2.0), Outline.of_box(x, -1.5, 0.0, 0.12, 2.0)


@pytest.mark.parametrize("speed", [0.0, 0.15, 0.3, 0.5])
@pytest.mark.parametrize(
    "around",
    [
        Surroundings((-1.0, 5.0, -0.6, 0.7)),
        Surroundings((-1.0, 5.0, -2.0, 2.0), _frame(1.2)),
        Surroundings(None, (Outline.of_box(1.0, 0.7, 0.4, 0.4, 0.3),)),
    ],
    ids=["wall", "door", "box"],
)
def test_driving_past_static_objects_rarely_reports_an_intruder(
    around: Surroundings, speed: float
) -> None:
    assert drive_past(around, speed, seconds=4.0) <= 8


def test_turning_on_the_spot_reports_no_intruder() -> None:
    assert drive_past(Surroundings((-1.0, 1.5, -0.8, 0.9)), 0.0, 0.5, 4.0) == 0


def verdicts(
    wanted: tuple[float, float], range_at: Callable[[float], float | None]
) -> Sequence[str]:
    """Return the levels while something comes from the left and the camera sees free floor."""
    guard, sonars, levels = Guard(P), {}, []
    bearings = tuple(np.radians(np.arange(-30.0, 31.0, 10.0)).tolist())
    n = len(bearings)
    free = FreeScan(bearings, (None,) * n, (1.0,) * n, (4.0,) * n)
    for k in range(100):
        now = 10 + 0.02 * k
        if k % 2 == 0:
            i = (k // 2) % 8
            pose = AMIGO.sonars[i]
            echo = range_at(now - 10) if i == LEFT else None
            sonars[i] = SonarReading(i, pose.x, pose.y, pose.heading, echo, now)
        sight = Sight(k, now, now, "real", Status.OK, (), True, (), free)
        verdict = guard.limit(
            "observer", wanted, wanted, sight, "real", tuple(sonars.values()),
            BodyOutline(AMIGO.length_m, AMIGO.width_m, AMIGO.radius_m), now,
        )  # fmt: skip
        # Skip the first round of readings.
        if k > 45:
            levels.append(verdict.level)
            assert verdict.comes == (verdict.level != "clear")
    return levels


def test_only_an_approaching_intruder_limits_the_robot_and_only_while_driving() -> None:
    def coming(time: float) -> float:
        return 1.7 - 0.6 * time

    assert verdicts((0.3, 0.0), coming)[-1] in {"slow", "stop"}
    assert set(verdicts((0.3, 0.0), lambda time: 0.6 + 0.6 * time)) == {"clear"}
    assert set(verdicts((0.3, 0.0), lambda _: 0.6)) == {"clear"}
    # A standing robot is never reported as limited.
    assert set(verdicts((0.0, 0.0), coming)) == {"clear"}
