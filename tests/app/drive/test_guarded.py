"""A robot that drives autonomously: it may move while an operator is present and consents."""

from __future__ import annotations

from typing import Any

from observer.guard.guard import Verdict

SLOW = Verdict("slow", False, 0.1, 0.0, "obstacle 3 would be met in 0.9 s", 0.1, (), ())


def guarded(bench: Any) -> Any:
    """An armed robot, with an operator present."""
    bench.connect("observer")
    bench.lease("observer")
    robot = bench.robots["observer"]
    robot.change(wanted=(0.3, 0.1))
    bench.present("observer")
    bench.arm("observer")
    bench.stay("observer", 2.0)
    return robot


def test_the_wanted_velocity_is_permitted_within_the_guards_limits(bench: Any) -> None:
    robot = guarded(bench)
    assert robot.velocities[-1] == (0.3, 0.1)
    bench.guard.answers["observer"] = SLOW
    bench.stay("observer", 0.2)
    assert robot.velocities[-1] == (0.1, 0.0)
    bench.guard.answers.clear()
    robot.change(wanted=(0.0, 0.0))
    bench.stay("observer", 0.2)
    assert robot.velocities[-1] == (0.0, 0.0)


def test_the_robot_is_disarmed_when_no_operator_is_present(bench: Any) -> None:
    robot = guarded(bench)
    bench.run(0.4)
    assert bench.state("observer") == "disarmed"
    bench.stay("observer", 1.0)
    assert bench.state("observer") == "disarmed"
    bench.arm("observer")
    bench.stay("observer", 2.0)
    assert robot.velocities[-1] == (0.3, 0.1)


def test_the_robot_is_disarmed_after_a_brief_silence(bench: Any) -> None:
    robot = guarded(bench)
    robot.silent = True
    bench.stay("observer", 0.4)
    robot.silent = False
    bench.stay("observer", 1.0)
    assert bench.state("observer") == "disarmed"
    assert "has not reported its state" in bench.why("observer")


def test_the_robot_is_disarmed_after_a_brief_loss_of_sight(bench: Any) -> None:
    guarded(bench)
    seen, bench.seeing = bench.seeing, None
    bench.stay("observer", 0.4)
    bench.seeing = seen
    bench.stay("observer", 1.0)
    assert bench.state("observer") == "disarmed"
