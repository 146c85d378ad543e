"""One turn of the drive loop at a time: requests in, answers and events out."""

from __future__ import annotations

import json
import queue
from typing import Any

import pytest

from app.contract.drive import (
    ArmRobot,
    ConnectRobot,
    DriveCommand,
    DriveState,
    IncidentEvent,
    LeaveDrive,
    ResetStop,
    StopRobots,
    TakeLease,
    WheelSpeedEvent,
)
from app.contract.values import plain
from app.drive.loop import DriveLoop, Inbox
from app.runtime.requests import Reply, Request
from observer.rig.rig import ROLES
from observer.robots.contract import SonarReading
from observer.types import Odometry


class Turning:
    """A loop that the test turns step by step."""

    def __init__(self, bench: Any) -> None:
        self.bench = bench
        self.inbox: Inbox = queue.SimpleQueue()
        self.sent: list[Any] = []
        self.wheels: list[dict[str, Any]] = []
        self.orphaned = False
        self.lost = 0
        self.number = 0
        self.loop = DriveLoop(
            roles=bench.roles,
            inbox=self.inbox,
            send=self.sent.append,
            wheel_speeds_lost=lambda: self.lost,
            newest_sight=lambda _: bench.sight,
            newest_plan=lambda _: bench.plan,
            write_wheels=self.wheels.append,
            orphaned=lambda: self.orphaned,
            priority="normal",
            clock=lambda: bench.now,
        )

    def turn(self, count: int = 1) -> None:
        for _ in range(count):
            self.bench.pass_time()
            self.bench.see()
            self.loop.tick(self.bench.now)

    def put(self, command: Any) -> int:
        self.number += 1
        self.inbox.put(Request(self.number, command))
        return self.number

    def ask(self, command: Any) -> Reply:
        number = self.put(command)
        self.turn()
        return self.reply(number)

    def reply(self, number: int) -> Reply:
        (found,) = [m for m in self.sent if isinstance(m, Reply) and m.number == number]
        return found

    def events(self, kind: type) -> list[Any]:
        return [m for m in self.sent if isinstance(m, kind)]

    def ready(self, role: Any) -> str:
        port = self.bench.robots[role].port
        assert self.ask(ConnectRobot(role, port, None, "real", "robot")).value is None
        lease = self.ask(TakeLease(role, "Ann")).value
        answer = self.ask(ArmRobot(role, lease)).value
        assert answer is not None
        assert answer.state == "armed"
        return str(lease)


@pytest.fixture
def turning(bench: Any) -> Turning:
    return Turning(bench)


def test_a_command_reply_gives_the_velocity_sent_in_the_same_turn(turning: Turning) -> None:
    lease = turning.ready("obstacle")
    answers = []
    for number in range(80):
        now = turning.bench.now
        command = DriveCommand("obstacle", lease, number, now, 0.9, 0.0)
        answers.append(turning.ask(command).value)
        assert answers[-1].speed_mps == turning.bench.robots["obstacle"].velocities[-1][0]
    assert plain(answers[0]) == {
        "speed_mps": pytest.approx(0.006),
        "turn_rate_radps": 0.0,
        "limited_by": "it is still accelerating",
        "age_s": pytest.approx(0.02),
    }
    turning.bench.robots["obstacle"].most = 0.2
    answer = turning.ask(DriveCommand("obstacle", lease, 99, turning.bench.now, 0.9, 0.0))
    assert (answer.value.speed_mps, answer.value.limited_by) == (
        0.2,
        "the obstacle's robot cannot go faster",
    )
    refused = turning.ask(DriveCommand("obstacle", lease, 99, turning.bench.now, 0.9, 0.0))
    assert (refused.value, refused.refusal) == (None, "state")
    assert "greater than the last one, 99" in str(refused.error)


def test_a_stop_queued_behind_many_commands_takes_effect_in_the_same_turn(turning: Turning) -> None:
    lease = turning.ready("obstacle")
    numbers = [
        turning.put(DriveCommand("obstacle", lease, n, turning.bench.now, 0.3, 0.0))
        for n in range(50)
    ]
    turning.put(StopRobots("Bob"))
    turning.turn()
    answer = turning.reply(numbers[-1]).value
    assert answer is not None
    assert answer.speed_mps == 0.0
    assert "stopped by Bob" in answer.limited_by
    assert turning.bench.robots["obstacle"].calls[-1] == ("stop",)
    assert [e.kind for e in turning.events(IncidentEvent)] == ["stop"]
    assert plain(turning.events(DriveState)[-1].facts)["stopped"]["by"] == "Bob"


def test_events_are_sent_ten_times_a_second_and_immediately_on_change(turning: Turning) -> None:
    turning.turn(50)
    assert len(turning.events(DriveState)) in (10, 11)
    turning.ready("observer")
    turning.turn(3)
    before = len(turning.events(DriveState))
    turning.bench.robots["observer"].change(fault="a wheel stalled")
    turning.turn()
    assert len(turning.events(DriveState)) > before
    robot = plain(turning.events(DriveState)[-1].facts)["robots"]["observer"]
    assert (robot["state"], robot["why"]) == ("disarmed", "a wheel stalled")


def test_facts_are_json_serialisable_and_complete(turning: Turning) -> None:
    turning.ready("observer")
    turning.bench.robots["observer"].change(
        sonars=(SonarReading(0, 0.1, 0.1, 1.57, None, 100.0),),
        stalled=(False, True),
        counters={"packets": 3},
    )
    turning.turn(10)
    facts = plain(turning.events(DriveState)[-1].facts)
    assert json.loads(json.dumps(facts, allow_nan=False)) == facts
    assert facts["robots"]["obstacle"] is None
    robot = facts["robots"]["observer"]
    assert robot["report"]["phase"] == "connected"
    assert robot["report"]["sonars"][0]["range_m"] is None
    assert robot["report"]["counters"] == {"packets": 3}
    assert set(robot) == {
        "port", "name", "world", "state", "operator", "present", "why", "commanded", "sent",
        "guard", "report",
    }  # fmt: skip
    assert set(facts) == {"stopped", "sight", "loop", "programme", "goal", "robots"}
    assert facts["sight"] == {"age_s": 0.0, "status": "ok", "world": "real"}


def test_odometry_of_the_last_second_is_shared_while_connected(turning: Turning) -> None:
    turning.ready("obstacle")
    robot = turning.bench.robots["obstacle"]
    robot.silent = True
    for number in range(20):
        robot.change(odometry=Odometry(0.03 * number, 0.0, 0.1), received=turning.bench.now + 0.02)
        turning.turn(5)
    path = turning.wheels[-1]["obstacle"]
    assert len(path) == 10
    assert path[-1] == [pytest.approx(turning.bench.now - 0.08), pytest.approx(0.57), 0.0, 0.1]
    assert path[-1][0] - path[0][0] <= 1.0
    speeds = turning.events(WheelSpeedEvent)
    assert {event.role for event in speeds} == {"obstacle"}
    robot.change(phase="waiting")
    turning.turn(2)
    assert turning.wheels[-1] == {role: [] for role in ROLES}


def test_the_state_tells_how_many_wheel_speeds_were_dropped(turning: Turning) -> None:
    turning.lost = 7
    turning.turn(5)
    assert plain(turning.events(DriveState)[-1].facts)["loop"]["wheel_speeds_lost"] == 7


def test_an_unknown_port_is_refused_as_input(turning: Turning) -> None:
    reply = turning.ask(ConnectRobot("observer", "x", None, "real"))
    assert reply.refusal == "input"
    assert "'x'" in str(reply.error)


def test_an_internal_failure_stops_the_robots_and_silences_events(turning: Turning) -> None:
    turning.ready("obstacle")
    turning.loop._newest_sight = None
    turning.turn()
    assert turning.bench.robots["obstacle"].calls[-1] == ("stop",)
    assert turning.bench.roles.stopped is not None
    before = len(turning.events(DriveState))
    turning.turn(20)
    assert len(turning.events(DriveState)) == before, "silence lets the supervisor replace it"
    reply = turning.ask("no command")
    assert reply.refusal == "input"


def test_every_new_failure_is_logged_and_a_lasting_one_once_a_second(
    turning: Turning, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(error: Exception) -> None:
        def raising(_: float) -> None:
            raise error

        turning.loop._newest_sight = raising

    fail(ValueError("first"))
    turning.turn(40)
    fail(KeyError("second"))
    turning.turn(55)
    told = [str(r.exc_info[1]) for r in caplog.records if r.exc_info and r.exc_info[1]]
    assert told == ["first", "'second'", "'second'"]


def test_requests_accepted_in_a_tick_that_fails_are_answered(turning: Turning) -> None:
    lease = turning.ready("obstacle")
    for count in range(20):
        turning.ask(DriveCommand("obstacle", lease, count, turning.bench.now, 0.3, 0.0))
    driven = turning.put(DriveCommand("obstacle", lease, 20, turning.bench.now, 0.3, 0.0))
    taken = turning.put(TakeLease("observer", "Bob"))
    reset = turning.put(ResetStop("Bob"))
    # Not a port at all: an error of the code, not of the input.
    failing = turning.put(ConnectRobot("observer", None, None, "real"))
    turning.turn()
    assert turning.bench.robots["obstacle"].calls[-1] == ("stop",)
    assert turning.reply(failing).refusal == "failure"
    answer = turning.reply(driven).value
    assert answer is not None
    assert (answer.speed_mps, answer.turn_rate_radps) == (0.0, 0.0)
    assert "the drive process, which failed" in answer.limited_by
    assert turning.reply(taken).refusal is None
    assert turning.reply(reset).refusal == "failure"
    assert turning.bench.roles.stopped is not None


@pytest.mark.parametrize("how", ["asked", "channel", "orphan"])
def test_any_exit_stops_the_robots_first(turning: Turning, how: str) -> None:
    for role in ROLES:
        turning.ready(role)
    if how == "asked":
        assert turning.ask(LeaveDrive()).refusal is None
    elif how == "channel":
        turning.inbox.put(None)
        turning.turn()
    else:
        turning.orphaned = True
        turning.turn()
    assert turning.loop.leaving
    assert all(robot.calls[-1] == ("stop",) for robot in turning.bench.robots.values())
