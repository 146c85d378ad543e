"""Driving programmes: with the consent of everybody whose robot moves."""

from __future__ import annotations

from typing import Any

import pytest

from app.contract.drive import (
    DisarmRobot,
    ReleaseLease,
    StartProgramme,
    StopProgramme,
    StopRobots,
)
from app.contract.values import plain
from app.runtime.errors import ProcessRefused
from observer.motion_profiles.profile import MotionProfile, Step
from observer.robots.contract import RobotPhase

BOTH = ("observer", "obstacle")
PAIR = MotionProfile(
    "pair", "", "",
    {"observer": (Step(2.0, 0.2),), "obstacle": (Step(1.0, 0.3), Step(1.0, -0.3))},
)  # fmt: skip


def prepare(bench: Any) -> None:
    for role in BOTH:
        bench.ready(role)
    stay(bench, 0.2)


def stay(bench: Any, seconds: float, *, roles: tuple[str, ...] = BOTH) -> None:
    for _ in range(round(seconds / 0.1)):
        for role in roles:
            bench.present(role)
        bench.tick(5)


def start(bench: Any, **more: Any) -> dict[str, Any]:
    answer: dict[str, Any] = bench.take(StartProgramme(PAIR, dict(bench.leases), **more))
    return answer


def test_both_robots_follow_the_programme_and_stop_at_its_end(bench: Any) -> None:
    prepare(bench)
    assert start(bench, repeat=2) == 4.0
    stay(bench, 0.9)
    assert bench.sent("obstacle")[0] > 0.2
    facts = plain(bench.roles.playing.facts(bench.now))
    assert facts["name"] == "pair"
    assert (facts["round"], facts["repeat"], facts["phase"]) == (1, 2, "driving")
    assert facts["elapsed_s"] == pytest.approx(0.9)
    stay(bench, 1.0)
    assert bench.sent("obstacle")[0] < -0.2
    assert bench.sent("observer")[0] == pytest.approx(0.2)
    stay(bench, 2.2)
    assert bench.roles.playing is None
    assert [bench.sent(role) for role in BOTH] == [(0.0, 0.0)] * 2
    assert [bench.state(role) for role in BOTH] == ["armed", "armed"]
    assert bench.incidents == []


def test_a_programme_starts_only_with_all_robots_armed_leased_and_attended(bench: Any) -> None:
    def refused(match: str) -> None:
        with pytest.raises(ProcessRefused, match=match):
            start(bench)
        assert bench.roles.playing is None

    bench.ready("observer")
    stay(bench, 0.2, roles=("observer",))
    refused("moves the obstacle; take control of it first")
    bench.connect("obstacle")
    bench.lease("obstacle")
    stay(bench, 0.2)
    refused("the obstacle is not armed")
    bench.arm("obstacle")
    bench.run(0.3)
    stay(bench, 0.2, roles=("observer",))
    refused("no operator is present for the obstacle")
    stay(bench, 0.2)
    bench.hold("obstacle", 0.2, 0.1)
    bench.present("observer")
    refused("driven manually")
    bench.drive("obstacle", 0.0)
    start(bench)
    with pytest.raises(ProcessRefused, match="pair is running"):
        start(bench)


def consents(bench: Any) -> None:
    stay(bench, 0.3, roles=("observer",))


def cannot_see(bench: Any) -> None:
    bench.seeing = None
    stay(bench, 0.3)


def stalls(bench: Any) -> None:
    bench.robots["obstacle"].change(fault="it stalled")
    stay(bench, 0.1)


def driver_fails(bench: Any) -> None:
    bench.robots["observer"].drive = None
    stay(bench, 0.1)
    del bench.robots["observer"].drive


def unplugged(bench: Any) -> None:
    bench.robots["observer"].change(phase=RobotPhase.WAITING)
    stay(bench, 0.1)


def disarmed(bench: Any) -> None:
    bench.take(DisarmRobot("obstacle"))
    stay(bench, 0.1)


def leaves(bench: Any) -> None:
    bench.take(ReleaseLease("obstacle", bench.leases["obstacle"]))
    bench.present("observer")
    bench.tick(5)


def grips(bench: Any) -> None:
    bench.drive("obstacle", 0.1)
    bench.tick(5)


@pytest.mark.parametrize(
    "what", [consents, cannot_see, stalls, driver_fails, unplugged, disarmed, leaves, grips]
)
def test_anything_that_stops_one_robot_ends_the_programme_for_all(bench: Any, what: Any) -> None:
    prepare(bench)
    start(bench)
    stay(bench, 0.7)
    assert all(bench.sent(role)[0] > 0.1 for role in BOTH)
    what(bench)
    assert bench.roles.playing is None
    assert [bench.sent(role) for role in BOTH] == [(0.0, 0.0)] * 2
    assert bench.kinds().count("programme") == 1
    bench.seeing = {}
    for role in BOTH:
        bench.robots[role].change(phase=RobotPhase.CONNECTED, fault=None)
    bench.run(0.5)
    assert [bench.sent(role) for role in BOTH] == [(0.0, 0.0)] * 2, "nothing goes on by itself"


def test_ending_the_programme_leaves_robots_armed_but_stop_disarms(bench: Any) -> None:
    prepare(bench)
    start(bench)
    stay(bench, 0.5)
    bench.take(StopProgramme())
    assert all(bench.robots[role].velocities[-1] == (0.0, 0.0) for role in BOTH)
    stay(bench, 0.5)
    assert [bench.state(role) for role in BOTH] == ["armed", "armed"]
    start(bench)
    stay(bench, 0.5)
    bench.take(StopRobots("Ann"))
    bench.tick()
    assert bench.roles.playing is None
    assert all(robot.calls[-1] == ("stop",) for robot in bench.robots.values())
