"""The observer drives to a goal: by plan, consent and guard, never without one of them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from app.contract.drive import (
    DisarmRobot,
    ReleaseLease,
    StartGoal,
    StartProgramme,
    StopGoal,
    StopRobots,
)
from observer.guard.guard import Verdict
from observer.motion_profiles.profile import MotionProfile, Step
from observer.navigation.plan import Plan, RefusedPath
from observer.types import Odometry, Status

from .scripted import Bench, refused


def prepare(bench: Bench) -> None:
    bench.ready("observer")
    bench.stay("observer", 0.1)


def start(bench: Bench, ahead: float = 3.0, left: float = 0.0, risk: float = 1e-3) -> Any:
    return bench.take(StartGoal(bench.leases["observer"], ahead, left, risk))


def stay(bench: Bench, seconds: float, speed: float = 0.3, **more: Any) -> None:
    """Keep the operator present, with a new plan for every frame."""
    for _ in range(round(seconds / 0.1)):
        bench.present("observer")
        for _ in range(5):
            bench.plan = plan(bench, speed, **more)
            bench.tick()


def plan(bench: Bench, speed: float = 0.3, turn: float = 0.0, **more: Any) -> Plan:
    going = bench.roles.goals.going
    number = 0 if going is None else going.goal.number
    made = Plan(number, bench.now, speed, turn, ((1.0, 0.0),), 1e-4, "Driving to the goal.")
    return replace(made, **more)


def goal(bench: Bench) -> Any:
    going = bench.roles.goals.going
    assert going is not None
    return going.facts(bench.now)


def ended(bench: Bench, because: str) -> None:
    assert goal(bench).state == "ended"
    assert because in goal(bench).sentence
    assert bench.roles.errand() is None
    assert bench.sent("observer") == (0.0, 0.0)
    bench.tick()
    assert bench.sent("observer") == (0.0, 0.0)


def test_the_robot_follows_the_plan_and_stops_at_the_goal(bench: Bench) -> None:
    prepare(bench)
    bench.robots["observer"].change(odometry=Odometry(1.0, 2.0, math.pi / 2))
    bench.tick()
    told = start(bench, 3.0, 1.0)
    assert (told.state, told.place, told.risk_per_metre) == ("driving", (3.0, 1.0), 1e-3)
    stay(bench, 1.5, turn=0.2)
    assert bench.sent("observer") == pytest.approx((0.3, 0.2))
    assert goal(bench).sentence == "Driving to the goal."
    errand = bench.roles.errand()
    assert errand is not None
    # In this pose, ahead is along y and left along -x.
    assert (errand.goal.x, errand.goal.y) == pytest.approx((0.0, 5.0))
    bench.robots["observer"].change(odometry=Odometry(0.1, 4.8, math.pi / 2))
    bench.tick()
    assert (goal(bench).state, goal(bench).sentence) == ("reached", "The goal is reached.")
    assert bench.sent("observer") == (0.0, 0.0)
    assert bench.state("observer") == "armed"
    assert "goal" not in bench.kinds()


def test_refused_paths_and_meeting_point_are_in_robot_coordinates(
    bench: Bench,
) -> None:
    prepare(bench)
    bench.robots["observer"].change(odometry=Odometry(1.0, 2.0, math.pi / 2))
    bench.tick()
    start(bench, 3.0)
    refused = RefusedPath(0.0, 0.5, ((1.0, 2.1), (1.0, 4.0)), "risk", 0.04, 3, 1.2)
    stay(bench, 0.3, waits_for=3, meets_s=1.2, meets_at=(0.5, 3.0), refused=(refused,))
    told = goal(bench)
    assert told.meets_at == pytest.approx((1.0, 0.5))
    assert [replace(one, path=()) for one in told.refused] == [replace(refused, path=())]
    np.testing.assert_allclose(told.refused[0].path, [(0.1, 0.0), (2.0, 0.0)], atol=1e-9)
    bench.take(StopGoal())
    assert (goal(bench).meets_at, goal(bench).refused) == (None, ())


def test_the_robot_stops_without_a_fresh_plan_for_this_goal(bench: Bench) -> None:
    prepare(bench)
    start(bench)
    bench.stay("observer", 0.3)
    assert bench.sent("observer") == (0.0, 0.0)
    assert goal(bench).sentence == "Waiting for a plan of the path."
    stay(bench, 1.0)
    assert bench.sent("observer")[0] > 0.2
    last = bench.now
    while bench.now - last < 0.3 - 0.021:
        bench.present("observer")
        bench.tick()
        assert bench.sent("observer")[0] > 0.2
    bench.present("observer")
    bench.tick(2)
    assert bench.sent("observer") == (0.0, 0.0)
    for bad in ({"goal": 7}, {"speed_mps": math.nan}, {"turn_rate_radps": math.inf}):
        stay(bench, 0.3, **bad)
        assert bench.sent("observer") == (0.0, 0.0)
    assert goal(bench).state == "driving"


def test_the_robot_stops_when_its_operator_is_gone(bench: Bench) -> None:
    prepare(bench)
    start(bench)
    stay(bench, 1.0)
    left = bench.now
    while bench.sent("observer") != (0.0, 0.0):
        bench.plan = plan(bench)
        bench.tick()
    assert bench.now - left <= 0.3
    ended(bench, "no command from the operator arrived in time")
    assert set(bench.kinds()) == {"expired", "goal"}
    # An operator who comes back has to send the goal again.
    stay(bench, 1.0)
    assert bench.sent("observer") == (0.0, 0.0)


@pytest.mark.parametrize(
    ("end", "because"),
    [
        (lambda bench: bench.take(DisarmRobot("observer")), "was disarmed"),
        (lambda bench: bench.take(StopRobots("Ann")), "stopped by Ann"),
        (lambda bench: bench.take(StopGoal()), "was cancelled"),
        (lambda bench: bench.drive("observer", 0.1), "driven manually"),
        (
            lambda bench: bench.take(ReleaseLease("observer", bench.leases["observer"])),
            "lost its operator",
        ),
        (lambda bench: bench.lease("observer", "Bob", takeover=True), "lost its operator"),
        (lambda bench: bench.robots["observer"].change(fault="a bumper is pressed"), "bumper"),
        (lambda bench: bench.robots["observer"].change(odometry=None), "odometry"),
    ],
)
def test_any_end_of_the_goal_stops_the_robot(bench: Bench, end: Any, because: str) -> None:
    prepare(bench)
    start(bench)
    stay(bench, 1.0)
    assert bench.sent("observer")[0] > 0.2
    end(bench)
    if "manually" in because:
        assert goal(bench).state == "ended"
        assert because in goal(bench).sentence
        return
    bench.tick()
    ended(bench, because)


def test_a_brief_loss_of_sight_only_pauses_the_goal(bench: Bench) -> None:
    prepare(bench)
    start(bench)
    stay(bench, 1.0)
    bench.seeing = {"status": Status.LOST, "reasons": ("too dark",)}
    stay(bench, 0.5)
    assert bench.sent("observer") == (0.0, 0.0)
    assert "too dark" in goal(bench).sentence
    bench.seeing = {}
    stay(bench, 0.2)
    assert bench.sent("observer") == (0.0, 0.0), "the operator has to be present for a moment"
    stay(bench, 1.5)
    assert bench.sent("observer")[0] > 0.2
    bench.seeing = {"status": Status.LOST, "reasons": ("too dark",)}
    stay(bench, 1.2)
    ended(bench, "too dark")
    assert bench.state("observer") == "disarmed"


def test_a_pause_after_a_loss_of_sight_has_its_reason(bench: Bench) -> None:
    """The plan says that it drives on, but the operator has to be present for a moment first."""
    prepare(bench)
    start(bench)
    stay(bench, 1.0)
    bench.seeing = {"status": Status.LOST, "reasons": ("too dark",)}
    bench.plan = plan(bench)
    bench.tick()
    bench.seeing = {}
    bench.plan = plan(bench)
    bench.tick()
    assert bench.sent("observer") == (0.0, 0.0)
    assert goal(bench).sentence == "Waiting: driving was interrupted and continues in a moment."
    stay(bench, 1.0)
    assert goal(bench).sentence == "Driving to the goal."


@pytest.mark.parametrize("status", [Status.LOST, Status.DEGRADED])
def test_a_loss_of_one_frame_only_pauses_the_goal(bench: Bench, status: Status) -> None:
    prepare(bench)
    start(bench)
    stay(bench, 1.0)
    bench.seeing = {"status": status, "reasons": ("blurred",)}
    bench.plan = plan(bench)
    bench.tick()
    assert bench.sent("observer") == (0.0, 0.0)
    bench.seeing = {}
    bench.plan = plan(bench)
    bench.tick()
    assert bench.sent("observer") == (0.0, 0.0)
    stay(bench, 1.5)
    assert goal(bench).state == "driving"
    assert bench.sent("observer")[0] > 0.2


def test_a_reopened_source_ends_the_goal(bench: Bench) -> None:
    prepare(bench)
    start(bench)
    stay(bench, 1.0)
    # Starting a run reopens the source: its frames are counted from 0 again.
    bench.frame = -1
    bench.plan = plan(bench)
    bench.tick()
    ended(bench, "the camera source was reopened")
    assert bench.state("observer") == "armed"
    stay(bench, 1.0)
    assert bench.sent("observer") == (0.0, 0.0)
    # The next goal is driven to with the reopened source.
    start(bench)
    stay(bench, 1.0)
    assert bench.sent("observer")[0] > 0.2


def test_a_failed_guard_ends_the_goal(bench: Bench) -> None:
    prepare(bench)
    start(bench)
    stay(bench, 1.0)
    bench.guard.answers["observer"] = RuntimeError("a bug")
    bench.plan = plan(bench)
    bench.tick(2)
    ended(bench, "the guard failed")
    bench.guard.answers.clear()
    stay(bench, 1.0)
    assert bench.sent("observer") == (0.0, 0.0)


def test_a_silent_robot_ends_the_goal_even_if_little_is_seen(bench: Bench) -> None:
    prepare(bench)
    start(bench)
    stay(bench, 1.0)
    bench.seeing = {"status": Status.LOST, "reasons": ("too dark",)}
    bench.robots["observer"].silent = True
    stay(bench, 0.4)
    ended(bench, "has not reported its state")


def test_missing_frames_end_the_goal(bench: Bench) -> None:
    prepare(bench)
    start(bench)
    stay(bench, 1.0)
    bench.seeing = None
    stay(bench, 0.4)
    ended(bench, "no camera frame")
    assert bench.state("observer") == "armed"
    bench.seeing = {}
    stay(bench, 1.0)
    assert bench.sent("observer") == (0.0, 0.0)


def test_the_guard_overrides_the_plan(bench: Bench) -> None:
    prepare(bench)
    start(bench)
    bench.guard.answers["observer"] = Verdict(
        "stop", False, 0.0, 0.0, "sonar 3 has an echo within 0.20 m", 0.0, (), ()
    )
    stay(bench, 0.5)
    assert bench.sent("observer") == (0.0, 0.0)
    assert goal(bench).sentence == "Waiting: sonar 3 has an echo within 0.20 m."
    del bench.guard.answers["observer"]
    stay(bench, 1.0)
    assert goal(bench).sentence == "Driving to the goal."


def test_a_new_goal_replaces_the_previous_one(bench: Bench) -> None:
    prepare(bench)
    start(bench, 3.0)
    stay(bench, 1.0)
    old = plan(bench)
    start(bench, -1.0, 2.0)
    bench.plan = replace(old, received=bench.now)
    bench.present("observer")
    bench.tick()
    assert goal(bench).place == (-1.0, 2.0)
    assert bench.roles.goals.going is not None
    assert bench.roles.goals.going.velocity == (0.0, 0.0)


def test_a_refusal_names_the_missing_condition(bench: Bench) -> None:
    bench.connect("observer")
    bench.lease("observer")
    lease = bench.leases["observer"]
    refused(bench, StartGoal(lease, 1.0, 0.0, 1e-3), "not armed")
    bench.arm("observer")
    refused(bench, StartGoal(lease, 1.0, 0.0, 1e-3), "no operator is present")
    bench.stay("observer", 0.1)
    refused(bench, StartGoal("nobody's", 1.0, 0.0, 1e-3), "control")
    refused(bench, StartGoal(lease, 30.0, 0.0, 1e-3), "30.0 m away", "input")
    refused(bench, StartGoal(lease, 0.2, -0.1, 1e-3), "already there", "input")
    refused(bench, StartGoal(lease, math.nan, 0.0, 1e-3), "finite", "input")
    refused(bench, StartGoal(lease, 1.0, 0.0, 0.0), "risk", "input")
    bench.robots["observer"].change(wanted=(0.1, 0.0))
    bench.tick()
    refused(bench, StartGoal(lease, 1.0, 0.0, 1e-3), "autonomously")
    bench.robots["observer"].change(wanted=None, odometry=None)
    bench.tick()
    refused(bench, StartGoal(lease, 1.0, 0.0, 1e-3), "no odometry")
    assert bench.roles.goals.going is None


def test_programme_and_goal_exclude_each_other(bench: Bench) -> None:
    prepare(bench)
    to_and_fro = MotionProfile("to", "", "", {"observer": (Step(2.0, 0.2),)})
    leases = {"observer": bench.leases["observer"]}
    start(bench)
    refused(bench, StartProgramme(to_and_fro, leases), "driving to a goal")
    bench.take(StopGoal())
    bench.take(StartProgramme(to_and_fro, leases))
    refused(bench, StartGoal(bench.leases["observer"], 1.0, 0.0, 1e-3), "is running")


def test_reconnecting_the_robot_drops_the_goal(bench: Bench) -> None:
    prepare(bench)
    start(bench)
    bench.connect("observer")
    assert bench.roles.goals.going is None
