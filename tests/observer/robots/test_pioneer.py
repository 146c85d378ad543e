"""The driver against an emulated robot over TCP and a pseudo terminal, and what may go wrong."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from observer.guard.parameters import GuardParameters
from observer.guard.sonar_clear import is_silent
from observer.robots import handshake, pioneer
from observer.robots.arcos import Command, command
from observer.robots.config_reply import ConfigReply
from observer.robots.contract import SETPOINT_FRESH_S, RobotLimits, RobotPhase, RobotReport
from observer.robots.serial_port import open_port
from observer.simulation.robots.emulated import EmulatedRobot

Drivens = Callable[..., Any]
ENABLE_1 = (int(Command.ENABLE), 1)
E_STOP = (int(Command.E_STOP), None)
STANDSTILL = [(29, None), (11, 0), (21, 0)]
PULSE = (0, None)


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
    monkeypatch.setattr(pioneer, "limits_in_force", lambda *_: limits)
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
    for direction in (0.3, -0.3):
        it.until(
            lambda report, direction=direction: (
                not is_silent(report.sonars, direction, time.monotonic(), GuardParameters())
            )
        )


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


@pytest.mark.parametrize("pty", [False, True])
def test_closing_ends_the_session_quickly(
    driven: Drivens, pty: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pioneer, "_FAREWELL_S", 0.1)
    it = driven(pty=pty)
    it.arm()
    it.drive(0.2)
    since = time.monotonic()
    it.robot.close()
    took = time.monotonic() - since
    it.robot.close()
    time.sleep(0.05)
    assert it.heard(since)[-5:] == [*STANDSTILL, (4, 0), (2, None)]
    told = it.there.log.since(since)
    assert told[-1].time - told[-2].time >= 0.09
    assert not it.there.is_open
    assert took < 2.0
    assert it.robot.report().phase is RobotPhase.CLOSED
    assert it.robot.drive(0.3, 0.0).speed_mps == 0.0


class TamperedPort:
    """A real port whose writes may be lost and whose reads may fail.

    Attributes:
        lose: commands that are lost in transit, each once. broken: whether reading fails in a
            way that no port does.
    """

    def __init__(self, text: str) -> None:
        self._port = open_port(text)
        self.lose: list[bytes] = []
        self.broken = False

    def __getattr__(self, name: str) -> Any:
        return getattr(self._port, name)

    def write(self, data: bytes) -> None:
        if data in self.lose:
            self.lose.remove(data)
        else:
            self._port.write(data)

    def read(self, timeout_s: float) -> bytes:
        if self.broken:
            raise RuntimeError("a mistake in the driver")
        return self._port.read(timeout_s)


@pytest.fixture
def tampered(driven: Drivens, monkeypatch: pytest.MonkeyPatch) -> tuple[Any, TamperedPort]:
    """An armed robot, and the port it is driven through."""
    ports: list[TamperedPort] = []

    def opened(text: str) -> TamperedPort:
        ports.append(TamperedPort(text))
        return ports[-1]

    monkeypatch.setattr(pioneer, "open_port", opened)
    it = driven()
    it.arm()
    it.drive(0.3)
    return it, ports[-1]


def test_a_lost_close_command_is_repeated(
    tampered: tuple[Any, TamperedPort], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pioneer, "_SILENT_S", 0.15)
    it, port = tampered
    port.lose.append(command(Command.CLOSE))
    began = time.monotonic()
    it.robot.close()
    assert time.monotonic() - began < 2.0
    assert port.lose == []
    time.sleep(0.05)
    assert not it.there.is_open


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_failed_driver_stops_the_robot(tampered: tuple[Any, TamperedPort]) -> None:
    it, port = tampered
    assert it.there.log.since()[-1].speed_mps > 0
    since = time.monotonic()
    port.broken = True
    report = it.drive_until(lambda report: report.phase is RobotPhase.REFUSED)
    assert report.trouble == report.fault == "its driver failed"
    time.sleep(0.05)
    told = it.there.log.first_standing(since)
    assert told is not None
    assert told.time - since < 0.3
    assert not it.there.motors_enabled


def test_closing_does_not_wait_for_a_missing_robot(
    piloted: Callable[..., Any], tmp_path: Path
) -> None:
    for port in (str(tmp_path / "nothing"), "socket://127.0.0.1:1"):
        robot = piloted(port)
        time.sleep(0.1)
        began = time.monotonic()
        robot.close()
        assert time.monotonic() - began < 1.0
        assert robot.report().phase is RobotPhase.CLOSED


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
