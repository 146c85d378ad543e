"""The driver against an emulated robot over TCP and a pseudo terminal."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Sequence
from functools import partial

import pytest

from observer.guard.parameters import GuardParameters
from observer.guard.sonar_clear import is_silent
from observer.robots import handshake, known_robot, pioneer
from observer.robots.config_reply import ConfigReply
from observer.robots.contract import SETPOINT_FRESH_S, RobotLimits, RobotReport
from observer.simulation.robots.emulated import EmulatedRobot

from .arcos_commands import E_STOP, ENABLE_1
from .conftest import Drivens


@pytest.mark.parametrize(("model", "pty"), [("p3dx-sh", False), ("amigo", True)])
def test_it_drives_and_reports_its_motion(driven: Drivens, model: str, pty: bool) -> None:
    it = driven(model, pty=pty)
    it.arm()
    it.drive(0.6, 0.3, 0.2)
    sent = it.robot.drive(0.3, 0.2)
    report = it.robot.report()
    assert (sent.speed_mps, sent.turn_rate_radps) == (0.3, math.radians(11))
    assert report.speed_mps == pytest.approx(0.3, abs=0.02)
    assert report.turn_rate_radps == pytest.approx(math.radians(11), abs=0.03)
    x, y, yaw = it.there.odometry
    assert report.odometry.x == pytest.approx(x, abs=0.07)
    assert report.odometry.y == pytest.approx(y, abs=0.03)
    assert report.odometry.yaw == pytest.approx(yaw, abs=0.05)
    assert len(report.sonars) == (16 if model == "p3dx-sh" else 8)
    assert report.battery == "good"
    assert report.fault is None
    assert report.counters["bad_packets"] == 0
    assert it.there.log.unintended == 0


def test_only_enabling_switches_the_motors_on(driven: Drivens) -> None:
    it = driven()
    it.connect()
    it.drive(0.2)
    assert it.robot.drive(0.3, 0.1).speed_mps == 0.0
    assert ENABLE_1 not in it.heard()
    assert it.there.speed_mps == 0.0
    it.arm()
    it.drive(0.25)
    assert it.there.speed_mps > 0.1
    it.robot.disable()
    it.until(lambda report: report.motors_enabled is False)
    before = time.monotonic()
    it.drive(0.3)
    assert ENABLE_1 not in it.heard(before)
    assert all(each.is_standstill for each in it.there.log.since(before))


def test_velocities_are_clamped_to_the_limits_in_force(
    driven: Drivens, monkeypatch: pytest.MonkeyPatch
) -> None:
    limits = RobotLimits(0.25, math.radians(30), 0.5, 1.0)
    monkeypatch.setattr(known_robot, "limits_in_force", lambda *_: limits)
    it = driven()
    it.arm()
    assert it.robot.report().limits == limits
    assert {(6, 250), (10, 30), (5, 500), (5, -500)} <= set(it.heard())
    it.drive(0.2, 9.0, -9.0)
    sent = it.robot.drive(9.0, -9.0)
    assert (sent.speed_mps, sent.turn_rate_radps) == (0.25, math.radians(-30))
    assert (11, 250) in it.heard()
    assert (21, -30) in it.heard()
    for bad in ((math.nan, 0.1), (0.1, math.inf)):
        it.drive(0.05)
        since = time.monotonic()
        sent = it.robot.drive(*bad)
        assert (sent.speed_mps, sent.turn_rate_radps) == (0.0, 0.0)
        time.sleep(0.05)
        assert it.there.log.first_standing(since) is not None


def test_zero_is_sent_at_once(driven: Drivens) -> None:
    it = driven(pty=True)
    it.arm()
    worst = 0.0
    for trial in range(4):
        it.drive(0.06, 0.3, 0.2)
        since = time.monotonic()
        if trial % 2:
            it.robot.stop()
        else:
            it.robot.drive(0.0, 0.0)
        time.sleep(0.05)
        first = it.there.log.first_standing(since)
        worst = max(worst, first.time - since)
        if trial % 2:
            assert it.heard(since)[:4] == [E_STOP, (11, 0), (21, 0), (4, 0)]
            it.arm()
    sys.stdout.write(f"zero after being asked for: worst {worst * 1000:.1f} ms\n")
    # A 20 ms loop asks for it after at most 250 ms; it must be there within 300.
    assert worst < 0.03 + 0.1


def test_a_hung_drive_loop_stops_the_robot(driven: Drivens) -> None:
    it = driven()
    it.arm()
    worst = 0.0
    for _ in range(2):
        it.drive(0.1)
        since = time.monotonic()
        time.sleep(SETPOINT_FRESH_S + 0.2)
        worst = max(worst, it.there.log.first_standing(since).time - since)
        assert it.robot.report().sent.speed_mps == 0.0
    sys.stdout.write(f"zero after the last drive: worst {worst * 1000:.1f} ms\n")
    assert worst < SETPOINT_FRESH_S + 0.1
    assert it.robot.report().motors_enabled


def test_an_idle_robot_never_trips_its_watchdog(driven: Drivens) -> None:
    it = driven(there=EmulatedRobot("p3dx-sh", now=time.monotonic(), watchdog_s=0.5))
    it.arm()
    assert it.robot.report().watchdog_s == 0.5
    until = time.monotonic() + 0.6
    while time.monotonic() < until:
        assert not it.there.timed_out
        time.sleep(0.01)


@pytest.mark.parametrize(
    ("model", "config", "fitted"),
    [
        ("p3dx-sh", ConfigReply(front_sonar=1, rear_sonar=1), range(16)),
        ("p3dx-sh", ConfigReply(front_sonar=1, rear_sonar=0), range(8)),
        ("amigo-sh", ConfigReply(front_sonar=1, rear_sonar=0), range(8)),
        ("p3dx-sh", ConfigReply(front_sonar=0, rear_sonar=0), ()),
        ("p3dx-sh", ConfigReply(), ()),
    ],
)
def test_fitted_sonars_that_never_reported_are_silent(
    driven: Drivens,
    monkeypatch: pytest.MonkeyPatch,
    model: str,
    config: ConfigReply,
    fitted: Sequence[int],
) -> None:
    monkeypatch.setattr(pioneer, "ask_config", lambda _: config)
    there = EmulatedRobot(model, now=time.monotonic())
    there.faults.sonar_overrun = True
    sonars = driven(there=there).connect().sonars
    assert [each.index for each in sonars] == list(fitted)
    silent = is_silent(sonars, 0.3, time.monotonic(), GuardParameters(sonar_fresh_s=5.0))
    assert silent == bool(fitted)


def test_sonars_are_heard_from_their_first_reading_on(driven: Drivens) -> None:
    it = driven()
    it.connect()

    def heard(direction: float, report: RobotReport) -> bool:
        return not is_silent(report.sonars, direction, time.monotonic(), GuardParameters())

    for direction in (0.3, -0.3):
        it.until(partial(heard, direction))


def test_a_watchdog_that_is_off_is_told_from_one_that_is_unknown(driven: Drivens) -> None:
    it = driven(there=EmulatedRobot("p3dx-sh", now=time.monotonic(), watchdog_s=0.0))
    report = it.connect()
    assert (report.watchdog_s, report.warnings) == (0.0, ())


def test_settings_that_were_not_reported_are_a_standing_warning(
    driven: Drivens, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(handshake, "_CONFIG_S", 0.1)
    there = EmulatedRobot("p3dx-sh", now=time.monotonic())
    there.faults.no_config_reply = True
    it = driven(there=there)
    report = it.connect()
    assert report.watchdog_s is None
    it.arm()
    warning = "it did not report its settings: bumpers and watchdog unknown"
    assert it.robot.report().warnings == (warning,)


def test_no_method_waits_for_the_port(driven: Drivens) -> None:
    it = driven(pty=True)
    it.arm()
    it.there.faults.silent = True
    longest = 0.0
    for _ in range(15):
        for call in (
            it.robot.report,
            lambda: it.robot.drive(0.2, 0.1),
            it.robot.stop,
            it.robot.clear,
            it.robot.enable,
            it.robot.disable,
        ):
            began = time.monotonic()
            call()
            longest = max(longest, time.monotonic() - began)
        time.sleep(0.01)
    assert longest < 0.1
