"""The state machine of both roles, with scripted robots and a clock that the test controls."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest

from app.contract.drive import (
    ArmRobot,
    ConnectRobot,
    DisarmRobot,
    DisconnectRobot,
    DriveCommand,
    ReleaseLease,
    ResetStop,
    StopRobots,
    TakeLease,
)
from app.runtime.errors import ProcessRefused
from observer.errors import InputError
from observer.rig.rig import ROLES
from observer.robots.contract import RobotPhase
from observer.types import Status

from .scripted import both, driving, refused

# --- arming -------------------------------------------------------------------------------------


def test_only_arming_enables_the_motors(bench: Any) -> None:
    bench.connect("observer")
    bench.lease("observer")
    bench.hold("observer", 0.3, 1.0)
    bench.take(ResetStop("Ann"))
    bench.hold("observer", 0.3, 0.5)
    assert bench.state("observer") == "disarmed"
    assert ("enable",) not in bench.robots["observer"].calls
    assert not any(bench.robots["observer"].velocities)
    bench.drive("observer", 0.0)
    bench.arm("observer")
    bench.tick()
    assert bench.state("observer") == "armed"
    bench.hold("observer", 0.3, 0.5)
    assert bench.state("observer") == "moving"


def test_an_arming_refusal_names_the_missing_condition(bench: Any) -> None:
    refused(bench, ArmRobot("observer", None), "no robot is connected as the observer")
    bench.seeing = None
    bench.connect("observer")
    robot = bench.robots["observer"]
    robot.change(phase=RobotPhase.CONNECTING, trouble="it does not answer")
    refused(bench, ArmRobot("observer", None), "not connected: it does not answer")
    robot.change(phase=RobotPhase.CONNECTED, trouble=None, fault="a wheel stalled")
    refused(bench, ArmRobot("observer", None), "a wheel stalled; reset it first")
    robot.change(fault=None, stop_pressed=True)
    refused(bench, ArmRobot("observer", None), "stop button .* is pressed")
    robot.change(stop_pressed=False, watchdog_s=0.0)
    refused(bench, ArmRobot("observer", None), "watchdog .* switched off, .*; set it to 2000 ms")
    robot.change(watchdog_s=2.0)
    refused(bench, ArmRobot("observer", None), "nothing can be seen")
    for seeing, match in (
        ({"mount_known": False}, "height and tilt"),
        ({"world": "simulated:lab:7"}, "a different world"),
        ({"world": None}, "a recording"),
        ({"status": Status.LOST}, "vision is lost"),
        ({"status": Status.DEGRADED, "reasons": ("few points",)}, "degraded: few points"),
    ):
        bench.seeing = seeing
        bench.tick()
        refused(bench, ArmRobot("observer", None), match)
    bench.seeing = {}
    bench.tick()
    bench.seeing = None
    bench.run(0.3)
    refused(bench, ArmRobot("observer", None), "no camera frame for 200 ms$")
    assert bench.sight is not None
    bench.sight = replace(bench.sight, published=bench.sight.received + 0.25)
    bench.tick()
    refused(bench, ArmRobot("observer", None), "200 ms; this computer is too slow to process one")
    bench.seeing = {}
    bench.tick()
    bench.lease("observer")
    refused(bench, ArmRobot("observer", None), "Ann controls the observer")
    refused(bench, ArmRobot("observer", "0" * 16), "you no longer control")
    bench.take(StopRobots("Bob"))
    refused(bench, ArmRobot("observer", bench.leases["observer"]), "stopped by Bob; reset")
    bench.take(ResetStop("Bob"))
    assert ("enable",) not in robot.calls
    bench.arm("observer")
    assert ("enable",) in robot.calls


def test_the_obstacle_drives_without_sight(bench: Any) -> None:
    bench.seeing = None
    bench.ready("obstacle")
    bench.hold("obstacle", 0.3, 2.0)
    assert bench.sent("obstacle") == (0.3, 0.0)
    assert all(sight is None for role, sight in bench.guard.sights if role == "obstacle")


def test_a_key_held_while_arming_must_be_released_first(bench: Any) -> None:
    bench.connect("obstacle")
    bench.lease("obstacle")
    bench.hold("obstacle", 0.3, 0.3)
    bench.arm("obstacle")
    bench.hold("obstacle", 0.3, 0.5)
    assert bench.sent("obstacle") == (0.0, 0.0)
    assert "release the controls" in bench.why("obstacle")
    bench.drive("obstacle", 0.0)
    bench.hold("obstacle", 0.3, 0.2)
    assert bench.state("obstacle") == "moving"


# --- commands -----------------------------------------------------------------------------------


def test_speed_is_ramped_up_but_zero_is_immediate(bench: Any) -> None:
    bench.ready("obstacle")
    bench.hold("obstacle", 0.3, 1.5)
    speeds = [speed for speed, _ in bench.robots["obstacle"].velocities]
    steps = [b - a for a, b in pairwise(speeds)]
    assert max(steps) <= bench.parameters.acceleration_mps2 * 0.02 + 1e-9
    assert speeds[-1] == 0.3
    bench.drive("obstacle", 0.0)
    bench.tick()
    assert bench.robots["obstacle"].velocities[-1] == (0.0, 0.0)


@pytest.mark.parametrize("still", ["command", "presence"])
def test_an_expired_command_sends_zero_until_the_key_is_released(bench: Any, still: str) -> None:
    bench.ready("obstacle")
    bench.hold("obstacle", 0.3, 1.5)
    last = bench.now - 0.1
    while bench.sent("obstacle") != (0.0, 0.0):
        if still == "presence" and round((bench.now - last) / 0.02) % 5 == 0:
            bench.present("obstacle")
        bench.tick()
        assert bench.now - last <= 0.25 + 1e-9
    assert bench.now - last >= 0.23 - 1e-9
    assert bench.kinds() == ["expired"]
    assert bench.state("obstacle") == "armed"
    for _ in range(5):
        bench.hold("obstacle", 0.3, 0.2)
        assert bench.sent("obstacle") == (0.0, 0.0)
    bench.drive("obstacle", 0.0)
    bench.tick()
    bench.hold("obstacle", 0.3, 0.2)
    assert bench.sent("obstacle")[0] > 0


def test_an_idle_operator_returning_may_drive_after_brief_presence(bench: Any) -> None:
    bench.ready("obstacle")
    bench.stay("obstacle", 1.0)
    bench.run(1.0)
    assert bench.incidents == []
    bench.stay("obstacle", 0.5)
    bench.hold("obstacle", 0.3, 0.3)
    assert bench.sent("obstacle")[0] > 0


def test_old_replayed_and_foreign_commands_are_refused_and_change_nothing(bench: Any) -> None:
    bench.ready("obstacle")
    bench.hold("obstacle", 0.3, 1.5)
    lease, number, now = bench.leases["obstacle"], bench.sequence, bench.now
    for command, match in (
        (DriveCommand("obstacle", lease, number + 1, now - 0.26, 0.5, 0.0), "260 ms old"),
        (DriveCommand("obstacle", lease, number, now, 0.5, 0.0), "greater than the last one"),
        (DriveCommand("obstacle", "0" * 16, number + 1, now, 0.5, 0.0), "you no longer control"),
    ):
        refused(bench, command, match)
    refused(
        bench, DriveCommand("obstacle", lease, number + 1, now, float("nan"), 0.0),
        "finite", "input",
    )  # fmt: skip
    refused(bench, DriveCommand("cart", lease, 1, now, 0.5, 0.0), "not a role", "input")  # type: ignore[arg-type]
    bench.tick()
    assert bench.roles.driven["obstacle"].asked == (0.3, 0.0)


def test_the_velocity_accepted_by_the_robot_counts_as_sent(bench: Any) -> None:
    bench.ready("obstacle")
    bench.robots["obstacle"].most = 0.2
    bench.hold("obstacle", 0.3, 1.5)
    assert bench.sent("obstacle") == (0.2, 0.0)
    assert "cannot go faster" in bench.why("obstacle")


# --- stop ---------------------------------------------------------------------------------------


def test_stop_reaches_all_robots_in_the_same_tick_and_latches(bench: Any) -> None:
    for role in ROLES:
        bench.ready(role)
    for _ in range(10):
        for role in ROLES:
            bench.drive(role, 0.3)
        bench.tick(5)
    bench.take(StopRobots("an operator at 10.0.0.7"))
    for name, robot in bench.robots.items():
        assert robot.calls[-1] == ("stop",)
        assert bench.state(name) == "disarmed"
    bench.tick()
    assert bench.kinds() == ["stop"]
    for role in ROLES:
        bench.drive(role, 0.0)
        bench.hold(role, 0.3, 0.3)
        refused(bench, ArmRobot(role, bench.leases[role]), "stopped by an operator at 10.0.0.7")
        assert "stopped by an operator" in bench.why(role)
        assert bench.sent(role) == (0.0, 0.0)
    bench.take(StopRobots("Eve"))
    assert bench.roles.stopped.by == "an operator at 10.0.0.7"
    bench.take(ResetStop("Ann"))
    bench.hold("observer", 0.3, 0.3)
    assert bench.state("observer") == "disarmed", "a reset arms nothing"
    assert all(("clear",) in robot.calls for robot in bench.robots.values())


# --- sight --------------------------------------------------------------------------------------


# --- faults and leases --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"fault": "the left wheel stalled"}, "left wheel"),
        ({"phase": RobotPhase.WAITING, "trouble": "the port is gone"}, "the port is gone"),
    ],
)
def test_a_fault_disarms_until_armed_again(bench: Any, change: Any, match: str) -> None:
    driving(bench)
    robot = bench.robots["obstacle"]
    robot.change(**change)
    bench.tick()
    assert robot.calls[-1] == ("disable",)
    assert bench.kinds() == ["fault"]
    assert match in bench.why("obstacle")
    assert bench.state("obstacle") in ("disarmed", "waiting")
    robot.change(phase=RobotPhase.CONNECTED, fault=None, trouble=None)
    bench.drive("obstacle", 0.0)
    both(bench, 0.5)
    assert bench.state("obstacle") == "disarmed"
    assert bench.sent("observer") == (0.3, 0.0), "the other one drives on"


@pytest.mark.parametrize("method", ["report", "drive"])
def test_a_failed_driver_is_closed_and_the_other_robot_drives_on(bench: Any, method: str) -> None:
    driving(bench)
    robot = bench.robots["observer"]
    setattr(robot, method, None)
    both(bench, 0.3)
    assert bench.state("observer") == "refused"
    assert "driver failed" in bench.why("observer")
    assert bench.openers["observer"].closed == [robot]
    assert bench.kinds() == ["fault"]
    assert bench.sent("obstacle") == (0.3, 0.0)


def test_a_driver_that_fails_to_stop_does_not_block_stopping_the_other(bench: Any) -> None:
    driving(bench)
    bench.robots["observer"].stop = None
    bench.take(StopRobots("Ann"))
    assert bench.robots["obstacle"].calls[-1] == ("stop",)
    both(bench, 0.2)
    assert bench.state("observer") == "disarmed"


def test_one_operator_holds_a_lease_and_takeover_disarms(bench: Any) -> None:
    bench.ready("obstacle")
    bench.hold("obstacle", 0.3, 1.0)
    refused(bench, TakeLease("obstacle", "Bob"), "Ann controls the obstacle; take control")
    bench.tick()
    assert bench.state("obstacle") == "moving"
    old = bench.leases["obstacle"]
    bench.lease("obstacle", "Bob", takeover=True)
    bench.tick()
    assert bench.state("obstacle") == "disarmed"
    assert bench.robots["obstacle"].velocities[-1] == (0.0, 0.0)
    assert [(i.kind, i.sentence) for i in bench.incidents] == [
        ("lease", "Bob took control of the obstacle from Ann")
    ]
    refused(
        bench,
        DriveCommand("obstacle", old, 999, bench.now, 0.3, 0.0),
        "you no longer control the obstacle, Bob",
    )
    # Sequence numbers start again with each lease.
    bench.sequence = 0
    bench.arm("obstacle")
    bench.hold("obstacle", 0.3, 0.3)
    assert bench.state("obstacle") == "moving"


def test_releasing_a_lease_stops_and_disarms(bench: Any) -> None:
    bench.ready("obstacle")
    bench.hold("obstacle", 0.3, 1.0)
    refused(bench, ReleaseLease("obstacle", "0" * 16), "you no longer control")
    bench.take(ReleaseLease("obstacle", bench.leases["obstacle"]))
    assert bench.robots["obstacle"].calls[-1] == ("disable",)
    assert (0.0, 0.0) in bench.robots["obstacle"].velocities[-1:]
    bench.tick()
    assert bench.state("obstacle") == "disarmed"
    assert bench.roles.leases.holder("obstacle") is None
    assert bench.roles.driven["obstacle"].why_disarmed == "its operator released control"


def test_a_lost_connection_to_the_operator_stops_and_says_so(bench: Any) -> None:
    bench.ready("obstacle")
    bench.hold("obstacle", 0.3, 1.0)
    bench.take(ReleaseLease("obstacle", bench.leases["obstacle"], lost=True))
    assert bench.robots["obstacle"].calls[-1] == ("disable",)
    assert bench.roles.driven["obstacle"].why_disarmed == "its operator is no longer connected"


def test_anyone_may_disarm(bench: Any) -> None:
    driving(bench)
    bench.take(DisarmRobot("observer"))
    both(bench, 0.3)
    assert bench.state("observer") == "disarmed"
    assert bench.why("observer") == "the observer is not armed"
    assert bench.kinds() == []
    assert bench.state("obstacle") == "moving"


# --- connections --------------------------------------------------------------------------------


def test_changing_the_port_disables_and_closes_the_old_robot(bench: Any) -> None:
    driving(bench)
    robot = bench.robots["observer"]
    bench.take(ConnectRobot("observer", "/dev/other", None, "real"))
    assert robot.calls[-1] == ("disable",)
    assert bench.openers["observer"].closed == [robot]
    bench.tick()
    assert bench.openers["observer"].ports == ["/dev/observer", "/dev/other"]
    assert not bench.roles.driven["observer"].armed
    refused(
        bench, ConnectRobot("observer", "/dev/obstacle", None, "real"),
        "is already the port of the obstacle", "input",
    )  # fmt: skip
    bench.take(DisconnectRobot("observer"))
    bench.tick()
    assert bench.state("observer") is None
    assert bench.openers["observer"].closed == [robot, robot]


def test_a_key_is_passed_to_the_driver_and_never_shown(bench: Any) -> None:
    key = "0123456789abcdefSECRET"
    port = f"external:0.0.0.0:7700?key={key}"
    bench.take(ConnectRobot("observer", port, None, "real"))
    bench.tick()
    assert bench.openers["observer"].ports[-1] == port
    assert bench.roles.driven["observer"].connection.port == "external:0.0.0.0:7700"
    # The same address with another key is the same port.
    with pytest.raises(ProcessRefused, match="is already the port of the observer") as told:
        bench.take(ConnectRobot("obstacle", f"{port}2", None, "real"))
    assert key not in str(told.value)


def test_an_invalid_or_unprepared_port_is_reported(bench: Any) -> None:
    for port, model in (("x", None), ("socket://host", None), ("/dev/ttyUSB0", "r2d2")):
        with pytest.raises(InputError):
            bench.take(ConnectRobot("observer", port, model, "real"))
    assert bench.state("observer") is None
    bench.openers["observer"].prepared = "install the client first"
    bench.take(ConnectRobot("observer", "coppeliasim:localhost:23000/P3DX", None, "real"))
    bench.tick()
    assert bench.state("observer") == "refused"
    refused(bench, ArmRobot("observer", None), "install the client first")
