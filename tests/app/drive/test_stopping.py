"""Stops measured to their end, with robots that roll out and report every 100 ms."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from app.contract.drive import (
    ConnectRobot,
    IncidentEvent,
    ReleaseLease,
    StoppedEvent,
    StopRobots,
)
from app.drive.stopping import StopWatch
from observer.guard.guard import Verdict
from observer.guard.sight import SeenObstacle
from observer.rig.rig import ROLES
from observer.robots.contract import RobotPhase, Sent, SonarReading
from observer.types import Odometry, Status

TICK_S = 0.02
BRAKES_MPS2 = 1.0
STOPPED = Verdict("stop", False, 0.0, 0.0, "obstacle 7 is too near", 0.0, (), ())


class Rolling:
    """The bench's robots, with wheels that follow the sent commands."""

    def __init__(self, bench: Any) -> None:
        self.bench = bench
        self.watches = [StopWatch(role) for role in ROLES]
        self.stops: list[StoppedEvent] = []
        self.told = 0
        self.x = dict.fromkeys(bench.robots, 0.0)
        self.speed = dict.fromkeys(bench.robots, 0.0)
        self.silent = False
        for robot in bench.robots.values():
            robot.change(received=bench.now)

    def tick(self, count: int = 1) -> None:
        bench = self.bench
        for _ in range(count):
            bench.now += TICK_S
            for role, robot in bench.robots.items():
                self._roll(role, robot)
            if bench.seeing is not None:
                bench.see(**bench.seeing)
            bench.roles.step(bench.now, bench.sight)
            incidents = bench.roles.incidents()
            bench.incidents += incidents
            self.stops += self.look(incidents)
        self.told += count

    def look(self, incidents: list[IncidentEvent]) -> list[StoppedEvent]:
        stops = [
            watch.update(self.bench.now, self.bench.roles, incidents) for watch in self.watches
        ]
        return [stop for stop in stops if stop is not None]

    def _roll(self, role: Any, robot: Any) -> None:
        wanted = robot.velocities[-1][0] if robot.velocities else 0.0
        if robot.calls and robot.calls[-1] in (("stop",), ("disable",)):
            wanted = 0.0
        most = BRAKES_MPS2 * TICK_S
        speed = self.speed[role]
        self.speed[role] = speed + max(-most, min(most, wanted - speed))
        self.x[role] += self.speed[role] * TICK_S
        if round(self.bench.now / TICK_S) % 5 == 0 and not self.silent:
            robot.change(
                received=self.bench.now,
                odometry=Odometry(self.x[role], 0.0, 0.0),
                speed_mps=self.speed[role],
            )

    def run(self, seconds: float) -> None:
        self.tick(round(seconds / TICK_S))

    def hold(self, role: str, speed: float, seconds: float) -> None:
        for _ in range(round(seconds / 0.1)):
            self.bench.drive(role, speed)
            self.tick(5)

    def ready(self, role: str) -> None:
        bench = self.bench
        bench.take(ConnectRobot(role, bench.robots[role].port, None, "real"))  # type: ignore[arg-type]
        self.tick()
        bench.lease(role)
        bench.arm(role)
        self.hold(role, 0.3, 1.5)
        assert self.speed[role] == pytest.approx(0.3)

    def only(self) -> StoppedEvent:
        (stop,) = self.stops
        return stop


@pytest.fixture
def rolling(bench: Any) -> Rolling:
    return Rolling(bench)


def test_an_expired_command_is_measured_from_the_last_sign_to_rest(rolling: Rolling) -> None:
    rolling.ready("obstacle")
    sign, x = rolling.bench.now - 0.1, rolling.x["obstacle"] - 0.1 * 0.3
    rolling.run(1.5)
    stop = rolling.only()
    assert (stop.role, stop.kind) == ("obstacle", "expired")
    assert stop.cause_time == pytest.approx(sign)
    assert stop.zero_time is not None
    assert 0.2 <= stop.zero_time - sign <= 0.26
    assert (stop.speed_mps, stop.before_mps) == (pytest.approx(0.3), pytest.approx(0.3))
    assert stop.stood_time is not None
    # 0.3 s of braking at 1 m/s^2, reported by the next packet.
    assert 0.28 <= stop.stood_time - stop.zero_time <= 0.42
    assert stop.distance_m == pytest.approx(rolling.x["obstacle"] - x, abs=0.003)
    assert stop.separation_m is None


def test_lost_sight_is_measured_from_the_last_good_frame(rolling: Rolling) -> None:
    bench = rolling.bench
    rolling.ready("observer")
    last = bench.now
    # Degraded frames are not good ones.
    bench.seeing = {"status": Status.DEGRADED, "reasons": ("the lens is covered",)}
    rolling.hold("observer", 0.3, 1.6)
    stop = rolling.only()
    assert (stop.kind, stop.cause_time) == ("sight", pytest.approx(last))
    assert "covered" in stop.sentence
    assert stop.zero_time == pytest.approx(last + TICK_S)
    assert stop.stood_time is not None
    # Afterwards the motors were switched off as well: that is not another stop.
    assert bench.kinds() == ["sight", "sight"]


def test_a_silent_camera_counts_as_lost_sight(rolling: Rolling) -> None:
    bench = rolling.bench
    rolling.ready("observer")
    last, bench.seeing = bench.now, None
    rolling.hold("observer", 0.3, 1.6)
    stop = rolling.only()
    assert stop.cause_time == pytest.approx(last)
    assert stop.zero_time is not None
    assert 0.2 <= stop.zero_time - last <= 0.24


def test_a_guard_stop_measures_separation_in_a_frame_at_rest(rolling: Rolling) -> None:
    bench = rolling.bench
    rolling.ready("observer")
    bench.guard.answers["observer"] = Verdict("slow", False, 0.1, 0.0, "soon", 0.1, (), ())
    rolling.hold("observer", 0.3, 1.0)
    assert rolling.stops == []
    bench.guard.answers["observer"] = STOPPED
    bench.robots["observer"].change(length_m=0.3, width_m=0.28)
    before = SeenObstacle(7, 0.9, 0.0, 0.0, 0.0, 0.2, None, None, False)
    after = SeenObstacle(7, 0.75, 0.0, 0.0, 0.0, 0.2, None, None, False)
    bench.seeing = {"obstacles": (before,)}
    rolling.hold("observer", 0.3, 0.1)
    verdict = bench.incidents[-1].time
    bench.seeing = {"obstacles": (after,)}
    rolling.hold("observer", 0.3, 0.5)
    stop = rolling.only()
    assert (stop.kind, stop.sentence) == ("guard", "obstacle 7 is too near")
    assert stop.cause_time == stop.zero_time == verdict
    assert stop.speed_mps == pytest.approx(0.1)
    # It was slowed down before it was stopped.
    assert stop.before_mps == pytest.approx(0.3)
    assert stop.separation_m == pytest.approx(0.75 - 0.2 - 0.15)


def test_a_nearer_echo_at_rest_overrides_the_seen_distance(rolling: Rolling) -> None:
    """A pane of glass: the camera sees what is behind it."""
    bench = rolling.bench
    robot = bench.robots["observer"]
    rolling.ready("observer")
    robot.change(length_m=0.3, width_m=0.28, sonars=(echo(0.9, bench.now),))
    bench.guard.answers["observer"] = STOPPED
    wall = SeenObstacle(7, 2.75, 0.0, 0.0, 0.0, 0.2, None, None, False)
    bench.seeing = {"obstacles": (wall,)}
    rolling.hold("observer", 0.3, 0.6)
    # It has stopped, but its sonar has not reported since.
    assert rolling.stops == []
    robot.change(sonars=(echo(0.4, bench.now),))
    rolling.tick()
    assert rolling.only().separation_m == pytest.approx(0.4)


def test_an_approaching_obstacle_gives_no_separation(rolling: Rolling) -> None:
    bench = rolling.bench
    rolling.ready("observer")
    bench.guard.answers["observer"] = replace(STOPPED, comes=True)
    wall = SeenObstacle(7, 2.75, 0.0, 0.0, 0.0, 0.2, None, None, False)
    bench.seeing = {"obstacles": (wall,)}
    rolling.hold("observer", 0.3, 0.6)
    assert rolling.only().separation_m is None


def test_a_sonar_that_falls_silent_is_not_awaited(rolling: Rolling) -> None:
    bench = rolling.bench
    rolling.ready("obstacle")
    bench.robots["obstacle"].change(length_m=0.3, width_m=0.28, sonars=(echo(0.4, bench.now),))
    bench.guard.answers["obstacle"] = STOPPED
    rolling.hold("obstacle", 0.3, 1.2)
    # The robot without a camera had no other measurement.
    assert rolling.only().separation_m is None


def echo(range_m: float | None, received: float) -> SonarReading:
    return SonarReading(0, 0.15, 0.0, 0.0, range_m, received)


def test_a_guard_stop_that_clears_while_moving_has_no_rest_time(rolling: Rolling) -> None:
    bench = rolling.bench
    rolling.ready("observer")
    bench.guard.answers["observer"] = STOPPED
    rolling.hold("observer", 0.3, 0.1)
    del bench.guard.answers["observer"]
    rolling.hold("observer", 0.3, 0.3)
    stop = rolling.only()
    assert (stop.stood_time, stop.distance_m, stop.separation_m) == (None, None, None)


def test_a_fault_is_measured_from_its_packet_and_the_time_zero_was_sent(rolling: Rolling) -> None:
    bench = rolling.bench
    rolling.ready("obstacle")
    robot = bench.robots["obstacle"]
    robot.change(sent=Sent(0.3, 0.0, bench.now))
    rolling.hold("obstacle", 0.3, 0.1)
    # Its driver does not wait for a tick: the zero is sent before a tick sees the fault.
    packet = bench.now
    robot.change(fault="a wheel stalled", received=packet, sent=Sent(0.0, 0.0, packet + 0.004))
    rolling.run(1.0)
    stop = rolling.only()
    assert (stop.kind, stop.sentence, stop.cause_time) == ("fault", "a wheel stalled", packet)
    assert stop.zero_time == pytest.approx(packet + 0.004)


def test_a_lost_port_is_measured_from_its_last_packet_and_given_up(
    rolling: Rolling,
) -> None:
    bench = rolling.bench
    rolling.ready("obstacle")
    robot = bench.robots["obstacle"]
    robot.change(sent=Sent(0.3, 0.0, bench.now))
    last = robot.state.received
    rolling.silent = True
    rolling.hold("obstacle", 0.3, 0.3)
    robot.change(phase=RobotPhase.WAITING, speed_mps=None, received=None)
    rolling.run(3.0)
    assert rolling.stops == []
    rolling.run(1.5)
    stop = rolling.only()
    assert (stop.kind, stop.cause_time, stop.zero_time) == ("fault", last, None)
    assert (stop.stood_time, stop.speed_mps) == (None, pytest.approx(0.3))


@pytest.mark.parametrize("counter", ["reconnects", "odometry_jumps"])
def test_a_stop_over_a_gap_in_the_odometry_has_no_distance(rolling: Rolling, counter: str) -> None:
    bench = rolling.bench
    rolling.ready("obstacle")
    robot = bench.robots["obstacle"]
    robot.change(sent=Sent(0.3, 0.0, bench.now))
    last = robot.state.received
    rolling.silent = True
    rolling.hold("obstacle", 0.3, 0.4)
    # It drove on unheard; its odometry continues where the last packet left it.
    rolling.run(1.5)
    robot.change(received=bench.now, speed_mps=0.0, sent=Sent(0.0, 0.0, bench.now))
    robot.change(counters={**robot.state.counters, counter: 1})
    back = bench.now
    rolling.run(1.0)
    stop = rolling.only()
    assert (stop.kind, stop.cause_time, stop.stood_time) == ("fault", last, back)
    assert stop.distance_m is None


def test_a_stop_is_measured_for_each_moving_robot(rolling: Rolling) -> None:
    bench = rolling.bench
    rolling.ready("observer")
    rolling.ready("obstacle")
    # The observer's operator was silent meanwhile.
    assert [(stop.role, stop.kind) for stop in rolling.stops] == [("observer", "expired")]
    rolling.stops.clear()
    bench.take(StopRobots("Bob"))
    asked = bench.now
    rolling.run(1.0)
    stop = rolling.only()
    assert (stop.role, stop.kind, stop.cause_time) == ("obstacle", "stop", asked)


def test_a_released_lease_is_measured_only_while_the_robot_rolls_out(rolling: Rolling) -> None:
    bench = rolling.bench
    rolling.ready("obstacle")
    # A page that closes lets go of the key, then its lease ends.
    bench.drive("obstacle", 0.0)
    given = bench.now
    rolling.tick(2)
    bench.take(ReleaseLease("obstacle", bench.leases["obstacle"]))
    rolling.run(1.0)
    stop = rolling.only()
    assert (stop.kind, stop.cause_time) == ("lease", given)
    assert stop.zero_time == pytest.approx(given + TICK_S)
    assert stop.speed_mps == pytest.approx(0.3)
    rolling.stops.clear()
    bench.lease("obstacle")
    bench.take(ReleaseLease("obstacle", bench.leases["obstacle"]))
    rolling.run(1.0)
    assert rolling.stops == []


def test_a_robot_without_encoders_or_odometry_gives_no_stop_distance(rolling: Rolling) -> None:
    bench = rolling.bench
    rolling.ready("obstacle")
    rolling.silent = True
    bench.robots["obstacle"].change(received=bench.now, odometry=None, speed_mps=None)
    rolling.hold("obstacle", 0.3, 0.1)
    rolling.run(6.2)
    stop = rolling.stops[0]
    assert stop.kind == "expired"
    assert (stop.distance_m, stop.stood_time) == (None, None)


def test_programme_incidents_and_other_roles_are_ignored(rolling: Rolling) -> None:
    rolling.ready("obstacle")
    told = [
        IncidentEvent(None, "programme", "it was ended", rolling.bench.now, None),
        IncidentEvent("observer", "fault", "a wheel stalled", rolling.bench.now, 0.3),
    ]
    stops = rolling.look(told)
    for _ in range(10):
        rolling.hold("obstacle", 0.3, 0.1)
    assert stops == rolling.stops == []
