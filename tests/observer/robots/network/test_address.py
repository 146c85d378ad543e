"""A custom robot over real TCP: our side, the reference client, and the wire between them."""

from __future__ import annotations

import statistics
import time

import pytest

from observer.robots.contract import Explained, RobotPhase
from observer.robots.network import link as external_link
from observer.robots.network.client import ExternalClient, ExternalClientError
from observer.robots.network.robot import ExternalRobot

from ....waiting import until
from .sides import RawRobot, Wire, driving, reporting, seconds_until, tell


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_failed_driver_is_reported_and_can_be_closed(
    free_port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(*_: object) -> None:
        raise RuntimeError("a mistake in the driver")

    monkeypatch.setattr(external_link.ExternalLink, "_serve", failing)
    robot = ExternalRobot(f"external:127.0.0.1:{free_port}")
    until(lambda: robot.report().phase is RobotPhase.REFUSED)
    assert robot.report().trouble == "its driver failed"
    robot.close()


def test_robot_messages_are_reported_and_velocities_are_permitted(
    robot: ExternalRobot, free_port: int
) -> None:
    with reporting(free_port, name="Robbie") as client:
        until(lambda: robot.report().received is not None)
        report = robot.report()
        assert (report.phase, report.name, report.fault) == (RobotPhase.CONNECTED, "Robbie", None)
        assert (report.radius_m, report.width_m, report.length_m) == (0.3, 0.4, 0.5)
        assert report.limits is not None
        assert report.limits.speed_mps == 0.5
        assert (report.watchdog_s, report.motors_enabled, report.wanted) == (0.25, False, None)
        until(lambda: client.permitted().reason == "not armed")
        with driving(robot, client):
            permit = client.permitted()
            assert (permit.speed_mps, permit.turn_rate_radps, permit.stop) == (0.3, 0.1, False)
            assert robot.drive(7.0, 0.0).speed_mps == 0.5
            until(lambda: robot.report().motors_enabled)
        # No velocity is requested any more.
        until(lambda: client.permitted().speed_mps == 0)
        assert client.permitted().reason == "no speed has been requested"
        assert not client.permitted().stop
        assert isinstance(robot, Explained)
        robot.explain("1.2 m before an obstacle")
        robot.drive(0.1, 0.0)
        until(lambda: client.permitted().reason == "1.2 m before an obstacle")
        robot.disable()
        until(lambda: client.permitted().stop)


def test_the_wanted_velocity_of_a_guarded_robot_is_reported(
    robot: ExternalRobot, free_port: int
) -> None:
    with reporting(free_port, guarded=True):
        until(lambda: robot.report().wanted == (0.4, 0.0))


def test_a_stop_does_not_wait_for_the_next_permit(robot: ExternalRobot, free_port: int) -> None:
    took = []
    with reporting(free_port) as client:
        for _ in range(20):
            with driving(robot, client):
                robot.stop()
                took.append(seconds_until(lambda: client.permitted().reason == "stopped"))
    tell(f"20 stops: median {1e3 * statistics.median(took):.1f}, worst {1e3 * max(took):.1f} ms")
    # Seconds: permits are 50 ms apart, so waiting for the next would take half of that.
    assert statistics.median(took) < 0.015


@pytest.mark.parametrize(
    ("stall_s", "faults"),
    [
        (0.6, ["no odometry received for 0.5 s"]),
        # On a busy machine the stall may be longer than intended.
        (0.35, ["its motors switched off by themselves", "no odometry received for 0.5 s"]),
    ],
)
def test_a_stalled_link_stops_the_robot_and_recovery_does_not_move_it(
    robot: ExternalRobot, wire: Wire, stall_s: float, faults: list[str]
) -> None:
    with reporting(wire.port) as client, driving(robot, client):
        wire.held.set()
        began = time.monotonic()
        stopped = seconds_until(lambda: client.permitted().stop)
        tell(f"stopped {1000 * stopped:.0f} ms after the link stalled")
        # The last permit before the stall may already be 50 ms old.
        assert 0.15 < stopped < 1.0
        assert client.permitted().reason == "no permit for 250 ms"
        time.sleep(max(0.0, began + stall_s - time.monotonic()))
        before = client.permitted().sequence
        wire.held.clear()
        until(lambda: client.permitted().sequence > before)
        deadline = time.monotonic() + 0.3
        while time.monotonic() < deadline:
            assert client.permitted().speed_mps == 0
            time.sleep(0.001)
        # The link has recovered, but the robot does not move until it is cleared and armed.
        assert client.permitted().reason == robot.report().fault
        assert robot.report().fault in faults
        robot.clear()
        robot.enable()
        until(lambda: client.permitted().speed_mps == 0.3)


def test_a_silent_robot_has_a_fault(robot: ExternalRobot, free_port: int) -> None:
    raw = RawRobot(free_port)
    assert raw.next() == {
        "type": "welcome", "protocol": 1, "interval_ms": 50, "expires_ms": 250,
    }  # fmt: skip
    raw.odometry(1)
    until(lambda: robot.report().motors_enabled is False)
    took = seconds_until(lambda: robot.report().fault is not None)
    tell(f"a silent robot has a fault after {1000 * took:.0f} ms")
    assert 0.4 < took < 1.5
    raw.close()


def test_a_broken_link_stops_both_sides(robot: ExternalRobot, wire: Wire) -> None:
    with reporting(wire.port) as client, driving(robot, client):
        wire.reset()
        assert seconds_until(lambda: client.permitted().stop) < 1.0
        assert seconds_until(lambda: robot.report().fault is not None) < 1.0
        assert not client.connected
        assert robot.report().phase is RobotPhase.WAITING
        with pytest.raises(ExternalClientError, match="the connection"):
            client.report(0, 0, 0, 0, 0, enabled=False)


def test_closing_our_side_stops_the_robot_and_frees_the_port(
    robot: ExternalRobot, free_port: int
) -> None:
    with reporting(free_port) as client, driving(robot, client):
        robot.close()
        assert seconds_until(lambda: client.permitted().stop) < 1.0
    robot.close()
    assert robot.report().phase is RobotPhase.CLOSED
    with pytest.raises(ExternalClientError, match="nothing listens"):
        ExternalClient("127.0.0.1", free_port).connect()
    again = ExternalRobot(f"external:127.0.0.1:{free_port}")
    until(lambda: again.report().phase is RobotPhase.WAITING)
    with reporting(free_port):
        assert again.report().phase is RobotPhase.CONNECTED
    again.close()


def test_replayed_messages_change_nothing(robot: ExternalRobot, free_port: int) -> None:
    raw = RawRobot(free_port)
    began = time.monotonic()
    for sequence in (1, 2, 3):
        raw.odometry(sequence, x=0.01 * sequence)
    until(lambda: robot.report().counters["packets"] == 3)
    # Only replayed packets from here on; they do not count as a sign of life.
    while robot.report().fault is None:
        raw.odometry(2, x=50.0, time=began)
        time.sleep(0.02)
        assert time.monotonic() < began + 2
    report = robot.report()
    assert report.fault == "no odometry received for 0.5 s"
    assert report.odometry is not None
    assert report.odometry.x == pytest.approx(0.02)
    assert report.counters["bad_packets"] > 5
    raw.close()
