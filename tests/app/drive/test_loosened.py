"""Changes of the guard's parameters under a moving robot."""

from __future__ import annotations

from typing import Any

import pytest

from app.contract.drive import SetGuard, StartGoal, StartProgramme
from observer.guard.guard import Verdict
from observer.motion_profiles.profile import MotionProfile, Step
from observer.navigation.plan import Plan

from .scripted import both, driving

LOOSER = SetGuard({"guard.margin_m": 0.01})
STRICTER = SetGuard({"guard.margin_m": 0.3, "guard.speed_max_mps": 0.4})


def test_loosening_the_guard_stops_who_drives_until_the_controls_are_released(bench: Any) -> None:
    driving(bench)
    bench.take(LOOSER)
    both(bench, 0.5)
    for role in ("observer", "obstacle"):
        assert (bench.state(role), bench.sent(role)) == ("armed", (0.0, 0.0))
        assert bench.why(role).startswith("the guard was loosened: release the controls")
        bench.drive(role, 0.0)
    bench.tick()
    both(bench, 0.3)
    assert [bench.state(role) for role in ("observer", "obstacle")] == ["moving", "moving"]
    # A later interruption is not put down to it.
    bench.run(0.5)
    both(bench, 0.1)
    assert bench.why("obstacle").startswith("driving was interrupted")


def test_a_held_key_that_the_guard_stopped_does_not_start_the_robot(bench: Any) -> None:
    driving(bench)
    stop = Verdict("stop", False, 0.0, 0.0, "something stands 0.2 m ahead", 0.0, (), ())
    bench.guard.answers["obstacle"] = stop
    both(bench, 0.1)
    assert bench.sent("obstacle") == (0.0, 0.0)
    bench.take(LOOSER)
    del bench.guard.answers["obstacle"]
    both(bench, 0.3)
    assert bench.sent("obstacle") == (0.0, 0.0)


@pytest.mark.parametrize("change", [STRICTER, SetGuard({})])
def test_tightening_the_guard_applies_at_once_and_interrupts_nobody(
    bench: Any, change: SetGuard
) -> None:
    driving(bench)
    bench.take(change)
    assert bench.guard.parameters[-1].speed_max_mps == change.parameters.get(
        "guard.speed_max_mps", bench.parameters.speed_max_mps
    )
    both(bench, 0.3)
    assert [bench.state(role) for role in ("observer", "obstacle")] == ["moving", "moving"]


def test_an_operator_at_rest_need_not_release_anything(bench: Any) -> None:
    bench.ready("obstacle")
    bench.stay("obstacle", 0.3)
    bench.take(LOOSER)
    bench.hold("obstacle", 0.3, 0.3)
    assert bench.state("obstacle") == "moving"


def test_loosening_the_guard_ends_a_programme(bench: Any) -> None:
    bench.ready("obstacle")
    bench.stay("obstacle", 0.2)
    profile = MotionProfile("there", "", "", {"obstacle": (Step(5.0, 0.3),)})
    bench.take(StartProgramme(profile, dict(bench.leases)))
    bench.stay("obstacle", 1.0)
    assert bench.sent("obstacle")[0] > 0.2
    bench.take(LOOSER)
    bench.stay("obstacle", 0.5)
    assert bench.roles.playing is None
    assert bench.sent("obstacle") == (0.0, 0.0)
    assert [(each.kind, each.sentence) for each in bench.incidents] == [
        (
            "programme",
            "the programme there was stopped: the obstacle was driving when the guard was loosened",
        )
    ]


def test_loosening_the_guard_ends_a_goal(bench: Any) -> None:
    bench.ready("observer")
    bench.stay("observer", 0.2)
    bench.take(StartGoal(bench.leases["observer"], 3.0, 0.0, 1e-3))
    number = bench.roles.goals.going.goal.number

    def go(seconds: float) -> None:
        for tick in range(round(seconds / 0.02)):
            bench.plan = Plan(number, bench.now, 0.3, 0.0, ((1.0, 0.0),), 1e-4, "Driving.")
            if tick % 5 == 0:
                bench.present("observer")
            bench.tick()

    go(1.0)
    assert bench.sent("observer")[0] > 0.2
    bench.take(LOOSER)
    go(1.0)
    assert not bench.roles.goals.driving
    assert bench.sent("observer") == (0.0, 0.0)
    assert bench.kinds() == ["goal"]


def test_loosening_the_guard_disarms_a_robot_that_drives_autonomously(bench: Any) -> None:
    bench.connect("observer")
    bench.lease("observer")
    bench.robots["observer"].change(wanted=(0.3, 0.0))
    bench.present("observer")
    bench.arm("observer")
    bench.stay("observer", 1.0)
    assert bench.state("observer") == "moving"
    bench.take(LOOSER)
    bench.stay("observer", 1.0)
    assert bench.state("observer") == "disarmed"
    assert bench.why("observer") == "disarmed: the guard was loosened"
