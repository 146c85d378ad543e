"""Faults that latch, the battery's mean, and when a robot may move, on a simulated clock."""

from __future__ import annotations

from dataclasses import replace

import pytest

from observer.robots.arcos import Command, command
from observer.robots.models import robot_spec
from observer.robots.robot_watch import RobotWatch
from observer.robots.sip import RobotStatus, decode_status

GOOD = replace(
    decode_status(bytes([0x32]) + bytes(19), robot_spec("p3dx-sh"), 3, 3),
    motors_enabled=True,
    battery_v=12.6,
)
OFF = replace(GOOD, motors_enabled=False)


def armed(now: float = 10.0) -> RobotWatch:
    watch = RobotWatch()
    watch.connected(now)
    watch.saw(OFF, now)
    assert watch.switch_on(now)
    watch.saw(GOOD, now + 0.1)
    assert watch.may_move
    return watch


def test_a_robot_may_move_only_once_its_motors_are_reported_on() -> None:
    watch = RobotWatch()
    assert not watch.switch_on(0.0)
    watch.connected(0.0)
    assert not watch.may_move
    watch.saw(GOOD, 0.1)
    assert not watch.may_move, "on, but not requested"
    assert watch.switch_on(0.2)
    watch.saw(OFF, 0.3)
    assert not watch.may_move
    watch.saw(GOOD, 0.4)
    assert watch.may_move
    watch.switch_off(0.5)
    assert not watch.may_move


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"stalled": (True, False)}, "left wheel stalled"),
        ({"stalled": (False, True)}, "right wheel stalled"),
        ({"front_bumpers": (False, False, True)}, "front bumper 3"),
        ({"rear_bumpers": (True, False, True)}, "rear bumper 1"),
        ({"stop_pressed": True}, "stop button"),
        ({"e_stalled": True}, "emergency stall"),
    ],
)
def test_a_fault_latches_until_its_cause_is_over_and_it_is_cleared(
    change: dict[str, object], words: str
) -> None:
    watch = armed()
    bad: RobotStatus = replace(GOOD, **change)  # type: ignore[arg-type]
    assert watch.saw(bad, 10.2)
    assert not watch.may_move
    assert words in (watch.fault or "")
    assert not watch.saw(bad, 10.3), "the same fault is not reported again"
    watch.clear(10.3)
    assert words in (watch.fault or ""), "its cause is still there"
    watch.saw(GOOD, 10.4)
    assert watch.fault is not None
    assert not watch.switch_on(10.4)
    watch.clear(10.5)
    assert watch.fault is None
    watch.saw(GOOD, 10.6)
    assert not watch.may_move, "motors stay off"


def test_motors_that_switch_off_by_themselves_are_not_switched_on_again() -> None:
    watch = armed()
    assert watch.saw(OFF, 11.0)
    assert "by themselves" in (watch.fault or "")
    for tenth in range(100):
        now = 11.0 + tenth / 10
        watch.saw(OFF, now)
        watch.tick(now)
        assert watch.due_command(now) is None


def test_an_ignored_enable_is_repeated_and_then_a_fault() -> None:
    watch = RobotWatch()
    watch.connected(0.0)
    watch.switch_on(0.0)
    told = []
    for tenth in range(1, 15):
        watch.saw(OFF, tenth / 10)
        assert not watch.tick(tenth / 10)
        if again := watch.due_command(tenth / 10):
            told.append((tenth, again))
    assert told == [(4, command(Command.ENABLE, 1)), (7, command(Command.ENABLE, 1))]
    watch.saw(OFF, 1.6)
    assert watch.tick(1.6)
    assert "did not switch on" in (watch.fault or "")


def test_packets_from_before_switching_are_no_fault() -> None:
    watch = armed()
    watch.switch_off(10.2)
    watch.switch_on(10.21)
    watch.saw(GOOD, 10.22)
    assert not watch.saw(OFF, 10.25)
    watch.saw(GOOD, 10.35)
    assert watch.may_move


def test_motors_that_stay_on_are_switched_off_again_with_a_warning() -> None:
    watch = armed()
    watch.switch_off(10.2)
    watch.saw(GOOD, 10.3)
    assert watch.due_command(10.3) is None
    assert watch.warnings(10.3) == ()
    watch.saw(GOOD, 10.8)
    assert watch.due_command(10.8) == command(Command.ENABLE, 0)
    assert watch.due_command(10.9) is None
    assert watch.warnings(10.8) == ("its motors are on although it is not armed",)


def test_silence_becomes_a_warning_and_then_a_fault() -> None:
    watch = armed()
    watch.saw(GOOD, 11.0)
    assert not watch.silent(11.29)
    assert watch.silent(11.31)
    assert "310 ms old" in watch.warnings(11.31)[0]
    assert not watch.tick(11.99)
    assert watch.tick(12.0)
    assert "the robot sent no status for 1 s; check its cable" in (watch.fault or "")
    watch.clear(12.5)
    assert "no status for 1.5 s" in (watch.fault or "")
    watch.saw(OFF, 12.6)
    watch.clear(12.7)
    assert watch.fault is None


@pytest.mark.parametrize(
    ("watchdog_s", "after_s"), [(None, 1.0), (0.0, 1.0), (2.0, 1.0), (0.4, 0.2)]
)
def test_an_outage_starts_before_the_watchdog_may_have_expired(
    watchdog_s: float | None, after_s: float
) -> None:
    watch = armed()
    watch.saw(GOOD, 11.0)
    assert not watch.in_outage(11.0 + after_s - 0.01, watchdog_s)
    assert watch.in_outage(11.0 + after_s + 0.01, watchdog_s)
    watch.lost("the cable is out", 12.0)
    assert not watch.in_outage(13.0, watchdog_s)


def test_a_lost_port_is_a_fault_until_reconnected_and_cleared() -> None:
    watch = armed()
    watch.lost("the cable is out", 10.5)
    assert watch.fault == "the cable is out"
    assert watch.status is None
    watch.clear(10.6)
    assert watch.fault == "the cable is out"
    watch.connected(11.0)
    watch.saw(OFF, 11.1)
    assert watch.fault == "the cable is out"
    assert not watch.switch_on(11.2)
    watch.clear(11.3)
    assert watch.fault is None


def test_a_port_that_never_existed_is_no_fault() -> None:
    watch = RobotWatch()
    watch.lost("there is no such device", 0.0)
    assert watch.fault is None


@pytest.mark.parametrize(
    ("volts", "judged"),
    [(12.6, "good"), (11.75, "good"), (11.7, "low"), (11.0, "low"), (10.9, "critical")],
)
def test_battery_levels(volts: float, judged: str) -> None:
    watch = RobotWatch()
    watch.connected(0.0)
    for tenth in range(5):
        watch.saw(replace(OFF, battery_v=volts), tenth / 10)
    assert watch.battery == judged
    assert bool(watch.warnings(0.4)) == (judged != "good")


def test_a_single_battery_dip_is_averaged_out() -> None:
    watch = RobotWatch()
    watch.connected(0.0)
    for tenth in range(20):
        watch.saw(replace(OFF, battery_v=10.0 if tenth == 10 else 12.6), tenth / 10)
    assert watch.battery == "good"
    assert watch.battery_v == pytest.approx((19 * 12.6 + 10) / 20)


def test_an_unknown_battery_is_none() -> None:
    watch = RobotWatch()
    watch.connected(0.0)
    watch.saw(replace(OFF, battery_v=None), 0.0)
    assert watch.battery_v is watch.battery is None
