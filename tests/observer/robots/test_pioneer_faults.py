"""What may go wrong between the driver and an emulated robot, and what is no fault."""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from observer.robots import pioneer
from observer.robots.arcos import Command
from observer.robots.contract import RobotPhase, RobotReport
from observer.simulation.robots.emulated import EmulatedRobot

from .arcos_commands import ENABLE_1, PULSE, STANDSTILL
from .conftest import Drivens


@pytest.mark.parametrize(
    ("name", "bad", "good", "words"),
    [
        ("stalled", (True, False), (False, False), "left wheel stalled"),
        ("front_bumpers", 0b10, 0, "front bumper 2"),
    ],
)
def test_a_fault_stops_it_and_latches(
    driven: Drivens, name: str, bad: object, good: object, words: str
) -> None:
    it = driven()
    it.arm()
    it.drive(0.25)
    began = time.monotonic()
    setattr(it.there.faults, name, bad)
    report = it.drive_until(lambda report: report.fault)
    it.drive(0.15)
    assert words in report.fault
    told = [each for each in it.there.log.since(began) if each.number == Command.E_STOP]
    after = told[0].time - report.received
    sys.stdout.write(f"E_STOP {after * 1000:.1f} ms after the packet of {words}\n")
    assert after < 0.2
    assert (4, 0) in it.heard(began)
    # A cause that goes away does not clear the fault, and clearing does not enable the motors.
    setattr(it.there.faults, name, good)
    it.drive(0.15)
    assert words in it.robot.report().fault

    def forgiven(report: RobotReport) -> bool:
        it.robot.clear()
        return report.fault is None

    it.until(forgiven)
    it.drive(0.15)
    assert all(each.is_standstill for each in it.there.log.since(told[0].time))
    it.arm()
    it.drive(0.25)
    assert it.there.speed_mps > 0.1


def test_motors_that_switch_off_by_themselves_stay_off(driven: Drivens) -> None:
    it = driven()
    it.arm()
    it.until(lambda _: it.robot.drive(0.3, 0.0).speed_mps > 0.0)
    it.drive(0.35)
    since = time.monotonic()
    it.there.motors_off()
    it.drive_until(lambda report: report.fault)
    assert "by themselves" in it.robot.report().fault
    it.drive(0.4)
    assert ENABLE_1 not in it.heard(since)


def test_silence_becomes_a_warning_then_a_fault_then_a_lost_robot(
    driven: Drivens, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pioneer, "_SILENCE_LOST_S", 1.2)
    it = driven()
    it.arm()
    it.there.faults.silent = True
    began = time.monotonic()
    warned = it.drive_until(lambda report: report.warnings)
    assert "ms old" in warned.warnings[0]
    assert warned.fault is None
    failed = it.drive_until(lambda report: report.fault)
    took = time.monotonic() - began
    assert "no status for 1 s" in failed.fault
    assert 0.85 <= took < 1.5
    lost = it.until(lambda report: report.phase is RobotPhase.WAITING)
    assert "sent nothing" in lost.trouble
    it.there.faults.silent = False
    back = it.connect()
    assert back.fault is not None
    assert back.motors_enabled is not True
    assert back.counters["reconnects"] == 1


def test_the_first_command_after_an_outage_is_a_standstill(driven: Drivens) -> None:
    """The firmware stopped by itself; any next command would make it resume its velocity."""
    it = driven(there=EmulatedRobot("p3dx-sh", now=time.monotonic(), watchdog_s=0.4))
    it.arm()
    it.drive(0.2)
    it.there.faults.deaf = it.there.faults.silent = True
    time.sleep(0.7)
    assert it.there.timed_out
    since = time.monotonic()
    it.there.faults.deaf = it.there.faults.silent = False
    it.drive(0.25)
    told = it.there.log.since(since)
    assert (told[0].number, told[0].argument) in STANDSTILL
    assert PULSE not in it.heard(since)
    assert it.heard(since)[1] in STANDSTILL
    assert it.there.log.first_standing(since).time - told[0].time < 0.25


@pytest.mark.parametrize("pty", [False, True])
def test_an_unplugged_port_is_a_fault_and_reconnects_at_standstill(
    driven: Drivens, pty: bool, tmp_path: Path
) -> None:
    serving = {"link": tmp_path / "robot"} if pty else None
    it = driven(pty=pty, serving=serving)
    it.arm()
    it.drive(0.2)
    place = it.robot.report().odometry
    began = time.monotonic()
    it.serving.robot.faults.unplugged = True
    report = it.drive_until(lambda report: report.fault)
    took = time.monotonic() - began
    sys.stdout.write(f"unplugged ({'pty' if pty else 'TCP'}): {took * 1000:.1f} ms\n")
    assert took < 0.5
    assert report.phase is not RobotPhase.CONNECTED
    assert report.motors_enabled is report.speed_mps is None
    assert it.robot.drive(0.3, 0.0).speed_mps == 0.0
    since = time.monotonic()
    it.serving.robot.faults.unplugged = False
    back = it.connect()
    assert back.fault == report.fault
    assert back.motors_enabled is not True
    assert math.dist((back.odometry.x, back.odometry.y), (place.x, place.y)) < 0.2
    it.robot.enable()
    it.drive(0.2)
    assert ENABLE_1 not in it.heard(since), "reconnecting does not clear a fault"
    assert all(each.is_standstill for each in it.there.log.since(since))
    it.robot.clear()
    it.arm()
    it.drive(0.25)
    assert it.there.speed_mps > 0.1


@pytest.mark.parametrize(
    "faults",
    [
        {"split": True, "double_header": True, "false_header": True, "strange_packets": True},
        {"merge_s": 0.15, "short_status": True},
    ],
)
def test_an_unusual_byte_stream_is_no_fault(driven: Drivens, faults: dict[str, Any]) -> None:
    there = EmulatedRobot("p3dx-sh", now=time.monotonic())
    for name, value in faults.items():
        setattr(there.faults, name, value)
    it = driven(there=there)
    it.arm()
    it.drive(0.5)
    report = it.robot.report()
    assert report.fault is None
    assert report.speed_mps == pytest.approx(0.3, abs=0.1)
    if "strange_packets" in faults:
        assert report.counters["unknown_packets"] > 10
    if "short_status" in faults:
        assert report.turn_rate_radps == pytest.approx(0.0, abs=0.02)
        assert report.temperature_c is None


@pytest.mark.parametrize("pty", [False, True])
def test_truncated_and_repeated_packets_neither_move_nor_mislead_it(
    driven: Drivens, pty: bool
) -> None:
    it = driven(pty=pty)
    it.arm()
    it.there.log.intended = lambda speed, turn: (speed, turn) in ((0.3, 0.0), (0.0, 0.0))
    it.there.faults.truncated, it.there.faults.repeated = 0.2, True
    it.drive(1.5)
    report = it.robot.report()
    assert report.fault is None
    assert report.speed_mps == pytest.approx(0.3, abs=0.05)
    it.drive(0.8, 0.0)
    it.there.faults.truncated, it.there.faults.repeated = 0.0, False
    it.drive(0.3, 0.0)
    report = it.robot.report()
    assert it.there.speed_mps < 0.01
    assert it.there.log.unintended == 0
    assert it.there.log.bad_bytes > 0
    assert report.counters["bad_packets"] > 0
    assert report.counters["odometry_jumps"] == 0
    assert report.odometry.x == pytest.approx(it.there.vehicle.state.x, abs=0.01)
    assert report.odometry.y == pytest.approx(0.0, abs=0.01)


def test_wrong_sensor_data_and_a_low_battery_are_no_fault(driven: Drivens) -> None:
    """No bumpers are fitted, the sonar count is wrong, and the battery is weak."""
    it = driven("amigo-sh")
    it.arm()
    it.until(lambda report: len(report.sonars) == 8)
    it.there.faults.phantom_bumpers = it.there.faults.sonar_overrun = True
    it.there.faults.battery_v = 11.2
    report = it.drive_until(lambda report: report.battery == "low")
    assert report.fault is None
    assert report.front_bumpers == ()
    assert {each.split(":")[0] for each in report.warnings} == {
        "its battery is low", "its sonar readings cannot be read",
    }  # fmt: skip
    newest = max(each.received for each in it.robot.report().sonars)
    it.drive(0.25)
    report = it.robot.report()
    assert max(each.received for each in report.sonars) == newest
    assert report.fault is None
    assert report.speed_mps > 0.1


def test_noise_is_counted_and_causes_no_unintended_motion(driven: Drivens) -> None:
    it = driven()
    it.arm()
    it.there.log.intended = lambda speed, turn: (speed, turn) in ((0.3, 0.0), (0.0, 0.0))
    it.there.faults.noise = 0.01
    until = time.monotonic() + 1.0
    while time.monotonic() < until:
        it.robot.drive(0.3, 0.0)
        time.sleep(0.02)
    it.there.faults.noise = 0.0
    assert it.there.log.unintended == 0
    assert it.there.log.bad_bytes > 0
    assert it.robot.report().counters["bad_packets"] > 0
