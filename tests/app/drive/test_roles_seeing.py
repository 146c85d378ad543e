"""Sight and the guard's verdicts, with scripted robots."""

from __future__ import annotations

from typing import Any

import pytest

from app.contract.drive import (
    SetGuard,
)
from observer.guard.guard import Verdict
from observer.rig.rig import ROLES, Role
from observer.types import Status

from .scripted import both, driving, refused

STOP = Verdict("stop", False, 0.0, 0.0, "something stands 0.2 m ahead", 0.0, (), ())
SLOW = Verdict("slow", False, 0.1, 0.0, "obstacle 3 would be met in 0.9 s", 0.1, (), ())


def test_expired_sight_stops_only_the_observer(bench: Any) -> None:
    driving(bench)
    assert bench.sent("observer") == (0.3, 0.0)
    last, bench.seeing = bench.now, None
    while bench.sent("observer") != (0.0, 0.0):
        bench.tick()
        bench.drive("observer", 0.3)
        bench.drive("obstacle", 0.3)
        assert bench.now - last <= 0.2 + 0.041
    assert bench.kinds() == ["sight"]
    assert bench.sent("obstacle") == (0.3, 0.0)
    # Frames that come back restart nothing while the key is held.
    bench.seeing = {}
    both(bench, 0.5)
    assert bench.state("observer") == "armed"
    bench.drive("observer", 0.0)
    bench.tick()
    both(bench, 0.3)
    assert bench.state("observer") == "moving"


def test_a_key_pressed_without_sight_starts_nothing_when_sight_returns(bench: Any) -> None:
    driving(bench)
    bench.seeing = {"status": Status.DEGRADED}
    both(bench, 0.2)
    bench.drive("observer", 0.0)
    bench.tick(2)
    both(bench, 0.3)
    bench.seeing = {}
    both(bench, 0.5)
    assert bench.sent("observer") == (0.0, 0.0)
    bench.drive("observer", 0.0)
    bench.tick()
    both(bench, 0.2)
    assert bench.state("observer") == "moving"


def test_a_second_without_sight_disarms(bench: Any) -> None:
    driving(bench)
    bench.seeing = None
    both(bench, 1.1)
    assert bench.state("observer") == "armed"
    both(bench, 0.2)
    assert bench.state("observer") == "disarmed"
    assert bench.robots["observer"].calls.count(("disable",)) == 1
    assert "no camera frame" in bench.why("observer")
    assert bench.kinds() == ["sight", "sight"]
    assert bench.state("obstacle") == "moving"
    bench.seeing = {}
    bench.drive("observer", 0.0)
    both(bench, 0.5)
    assert bench.state("observer") == "disarmed"


@pytest.mark.parametrize("role", ROLES)
def test_a_robot_that_stops_reporting_stops_and_must_be_released(bench: Any, role: Role) -> None:
    driving(bench)
    robot, other = bench.robots[role], next(each for each in ROLES if each != role)
    robot.silent, last = True, bench.now
    while bench.sent(role) != (0.0, 0.0):
        bench.tick()
        bench.drive("observer", 0.3)
        bench.drive("obstacle", 0.3)
        assert bench.now - last <= 0.3 + 1e-9
    assert bench.now - last > 0.2, "one report may be lost"
    assert robot.velocities[-1] == (0.0, 0.0)
    assert bench.why(role) == f"the {role}'s robot has not reported its state for 300 ms"
    assert bench.kinds() == ["fault"]
    # Reports that come back restart nothing while the key is held.
    robot.silent = False
    both(bench, 0.5)
    assert (bench.state(role), bench.sent(role)) == ("armed", (0.0, 0.0))
    assert bench.sent(other) == (0.3, 0.0)
    bench.drive(role, 0.0)
    bench.tick()
    both(bench, 0.3)
    assert bench.state(role) == "moving"


def test_a_second_of_silence_disarms(bench: Any) -> None:
    driving(bench)
    bench.robots["obstacle"].silent = True
    both(bench, 1.5)
    assert bench.state("obstacle") == "disarmed"
    assert "has not reported its state" in bench.why("obstacle")
    assert bench.kinds() == ["fault", "fault"]
    assert bench.state("observer") == "moving"


def test_a_robot_that_has_reported_nothing_yet_does_not_move(bench: Any) -> None:
    bench.robots["obstacle"].silent = True
    bench.robots["obstacle"].change(received=None)
    bench.ready("obstacle")
    bench.hold("obstacle", 0.3, 0.5)
    assert not any(speed for speed, _ in bench.robots["obstacle"].velocities)
    assert bench.kinds() == []


@pytest.mark.parametrize(
    "seeing",
    [
        {"status": Status.DEGRADED},
        {"status": Status.LOST},
        {"world": "simulated:lab:7"},
        {"world": None},
        {"mount_known": False},
    ],
)
def test_one_unusable_frame_stops_the_observer(bench: Any, seeing: Any) -> None:
    driving(bench)
    bench.seeing = seeing
    bench.tick()
    assert bench.sent("observer") == (0.0, 0.0)
    bench.seeing = {}
    both(bench, 0.5)
    assert bench.sent("observer") == (0.0, 0.0)


def test_the_guard_slows_stops_and_resumes_while_the_key_is_held(bench: Any) -> None:
    driving(bench)
    bench.guard.answers["observer"] = SLOW
    both(bench, 0.2)
    assert bench.sent("observer") == (0.1, 0.0)
    assert bench.why("observer") == SLOW.reason
    bench.guard.answers["observer"] = STOP
    both(bench, 0.2)
    assert bench.sent("observer") == (0.0, 0.0)
    assert bench.kinds() == ["guard"]
    bench.guard.answers.clear()
    both(bench, 1.5)
    assert bench.sent("observer") == (0.3, 0.0)


@pytest.mark.parametrize(
    "answer",
    [
        Verdict("clear", False, 0.9, 0.5, None, None, (), ()),
        Verdict("stop", True, 0.3, 0.0, "it cannot see", 0.0, (), ()),
        Verdict("clear", False, -0.3, -0.5, None, None, (), ()),
        Verdict("clear", False, float("nan"), float("nan"), None, None, (), ()),
        RuntimeError("a bug"),
    ],
)
def test_a_faulty_guard_never_makes_a_robot_faster(bench: Any, answer: Any) -> None:
    driving(bench)
    bench.guard.answers["observer"] = answer
    before = len(bench.robots["observer"].velocities)
    both(bench, 0.5)
    for speed, turn in bench.robots["observer"].velocities[before:]:
        assert 0.0 <= speed <= 0.3
        assert turn == 0.0
        assert speed == 0.0 or not (isinstance(answer, Verdict) and answer.blind)
    if not isinstance(answer, Verdict) or answer.blind or answer.speed_mps != 0.9:
        assert bench.sent("observer") == (0.0, 0.0)
    if isinstance(answer, Exception):
        assert "guard failed" in bench.why("observer")
        assert bench.sent("obstacle") == (0.3, 0.0)


def test_the_guard_parameters_are_validated_and_applied(bench: Any) -> None:
    bench.take(SetGuard({"guard.acceleration_mps2": 3.0}))
    assert bench.guard.parameters[-1].acceleration_mps2 == 3.0
    refused(bench, SetGuard({"guard.speed_max_mps": -1}), "guard.speed_max_mps", "input")
    refused(bench, SetGuard({"guard.nonsense": 1}), "guard.nonsense", "input")
    assert len(bench.guard.parameters) == 1
    bench.ready("obstacle")
    bench.hold("obstacle", 0.3, 0.1)
    assert bench.sent("obstacle")[0] == pytest.approx(0.3)
