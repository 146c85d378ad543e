"""Driving at the server: which robots the drive process gets, and what it is told."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncIterator
from dataclasses import asdict, replace
from datetime import UTC, datetime
from typing import Any

import pytest

from app.contract.drive import (
    ConnectRobot,
    DisconnectRobot,
    IncidentEvent,
    ResetStop,
    SetGuard,
    StoppedEvent,
    StopRobots,
    TakeLease,
    WheelSpeedEvent,
)
from app.contract.events import EngineState, StateEvent
from app.contract.robots import StopMeasured
from app.contract.values import json_text, plain
from app.server import NotAvailable, Server
from app.server.robots.connecting import wanted_robots
from app.server.robots.incidents import Incidents
from app.server.robots.operators import Operators
from app.server.robots.wheels import WheelLog
from app.server.runs.current_run import speed_rows, wheel_rows
from app.server.source_time import SourceInstant
from app.server.status import status
from app.storage import IncidentRecord, Storage, StorageMissing
from app.workers.frame_results import frame_result
from observer.navigation.parameters import AllParameters
from observer.rig.rig import Rig
from observer.robots.contract import RobotPhase, RobotPort, RobotReport

from ....waiting import until_async
from ..servers import begin, started

RIG = Rig(ports={"observer": "/dev/ttyUSB0"}, models={"observer": "amigo-sh", "obstacle": "p3dx"})
OWN = tuple(
    RobotPort(role, f"socket://127.0.0.1:{port}", model, f"the {role}")  # type: ignore[arg-type]
    for role, port, model in (("observer", 5001, "amigo-sh"), ("obstacle", 5002, "p3dx-sh"))
)


def shows(world: str | None, robots: Any = ()) -> StateEvent:
    return StateEvent(EngineState.PREVIEW, None, world=world, robots=robots)


@pytest.fixture
async def server(peer: Any, drive: Any, storage: Storage) -> AsyncIterator[Server]:
    """A server with a drive process, over a source without robots."""
    async with started(peer, storage, drive=drive) as server:
        yield server


def test_robots_belong_to_the_observed_world() -> None:
    assert wanted_robots(shows("simulated:lab/1", OWN), RIG) == {
        "observer": ConnectRobot(
            "observer", "socket://127.0.0.1:5001", "amigo-sh", "simulated:lab/1", "the observer"
        ),
        "obstacle": ConnectRobot(
            "obstacle", "socket://127.0.0.1:5002", "p3dx-sh", "simulated:lab/1", "the obstacle"
        ),
    }
    assert wanted_robots(shows("real"), RIG) == {
        "observer": ConnectRobot("observer", "/dev/ttyUSB0", "amigo-sh", "real")
    }
    # A world without robots, and a recording: neither drives the real robot.
    assert wanted_robots(shows("simulated:lab/1"), RIG) == {}
    assert wanted_robots(shows(None), RIG) == {}
    assert wanted_robots(shows(None, OWN), RIG) == {}


async def test_each_source_brings_its_own_robots(peer: Any, drive: Any, storage: Storage) -> None:
    peer.world, peer.robots = "simulated:lab/1", OWN
    async with started(peer, storage, drive=drive) as server:
        await until_async(lambda: len(drive.robots) == 2)
        server.rig.rig = RIG
        peer.world, peer.robots = "real", ()
        await server.source.open("camera:0,1", None)
        await until_async(lambda: set(drive.robots) == {"observer"})
        assert drive.robots["observer"].port == "/dev/ttyUSB0"
        peer.world = None
        await server.source.open("recorded", None)
        await until_async(lambda: not drive.robots)
        assert {c.role for c in drive.of(DisconnectRobot)} == {"observer", "obstacle"}
        # Nothing is repeated.
        told = len(drive.commands)
        peer.publish(peer.state())
        await asyncio.sleep(0.05)
        assert len(drive.commands) == told


async def test_a_lost_engine_keeps_the_robots_until_the_next_engine(
    peer: Any, drive: Any, storage: Storage
) -> None:
    peer.world, peer.robots = "simulated:lab/1", OWN
    async with started(peer, storage, drive=drive):
        await until_async(lambda: len(drive.robots) == 2)
        peer.lose()
        await asyncio.sleep(0.02)
        assert not drive.of(DisconnectRobot)
        peer.world = "simulated:lab/2"
        peer.start_process()
        await until_async(lambda: drive.robots["obstacle"].world == "simulated:lab/2")
        assert len(drive.of(ConnectRobot)) == 4


async def test_guard_parameters_are_sent_first_and_on_every_change(
    peer: Any, drive: Any, storage: Storage
) -> None:
    names = [name for name in AllParameters().flat() if name.startswith("guard.")]
    assert names

    peer.world, peer.robots = "simulated:lab/1", OWN
    async with started(peer, storage, drive=drive) as server:
        await until_async(lambda: len(drive.robots) == 2)
        assert isinstance(drive.commands[0], SetGuard)
        assert sorted(drive.commands[0].parameters) == sorted(names)
        await server.parameters.change({"guard.speed_max_mps": 0.4})
        await until_async(lambda: len(drive.of(SetGuard)) == 2)
        assert drive.of(SetGuard)[1].parameters["guard.speed_max_mps"] == 0.4
        # Other parameters do not concern the drive process.
        await server.parameters.change({"ego_motion.ransac_threshold_px": 2.0})
        drive.lose()
        drive.start_process()
        await until_async(lambda: len(drive.robots) == 2)
        assert len(drive.of(SetGuard)) == 3
        assert drive.of(SetGuard)[2] == drive.of(SetGuard)[1]
        drive.refuse[SetGuard] = ("input", "guard.speed_max_mps is too high")
        await server.parameters.change({"guard.speed_max_mps": 0.5})
        await until_async(lambda: server.driving.warnings)
        assert server.driving.warnings == ["guard.speed_max_mps is too high"]


async def test_a_refused_connection_is_reported_and_not_retried(
    peer: Any, drive: Any, storage: Storage
) -> None:
    peer.world, peer.robots = "simulated:lab/1", OWN
    drive.refuse[ConnectRobot] = ("input", "nothing answers there")
    async with started(peer, storage, drive=drive) as server:
        await until_async(lambda: len(server.driving.warnings) == 2)
        warnings = status(server).warnings
        assert "the obstacle is not connected: nothing answers there" in warnings
        trouble = server.driving.facts().trouble
        assert trouble["observer"] == "the observer is not connected: nothing answers there"
        told = len(drive.of(ConnectRobot))
        await asyncio.sleep(0.1)
        assert told == len(drive.of(ConnectRobot)) == 2
        drive.refuse.clear()
        # The robots of another source are a new request.
        peer.world = "simulated:lab/2"
        await server.source.open("simulated:other", None)
        await until_async(lambda: len(drive.robots) == 2)
        assert server.driving.warnings == []


async def test_an_unresponsive_robot_is_retried(
    peer: Any, drive: Any, storage: Storage, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.server.robots.connecting._RETRY_S", 0.02)

    peer.world, peer.robots = "simulated:lab/1", OWN
    drive.refuse[ConnectRobot] = ("failure", "the port is busy")
    async with started(peer, storage, drive=drive) as server:
        await until_async(lambda: len(drive.of(ConnectRobot)) > 5)
        assert "the port is busy" in server.driving.warnings[0]
        drive.refuse.clear()
        await until_async(lambda: len(drive.robots) == 2)
        assert server.driving.warnings == []


async def test_an_unresponsive_robot_is_disconnected_when_no_longer_wanted(
    peer: Any, drive: Any, storage: Storage
) -> None:
    peer.world, peer.robots = "simulated:lab/1", OWN
    drive.refuse[ConnectRobot] = ("failure", "it took too long")
    async with started(peer, storage, drive=drive) as server:
        await until_async(lambda: len(server.driving.warnings) == 2)
        assert not drive.of(DisconnectRobot)
        peer.world, peer.robots = None, ()
        await server.source.open("simulated:other", None)
        # It may be connected by now, so it is disconnected in any case.
        await until_async(lambda: len(drive.of(DisconnectRobot)) == 2)
        await until_async(lambda: server.driving.warnings == [])


async def test_a_stop_during_a_reset_holds(drive: Any, server: Server) -> None:
    await until_async(lambda: drive.health.alive)
    await server.driving.stop_robots("Anna")
    request = drive.request

    async def slow(command: Any, timeout_s: float = 1.0) -> Any:
        answer = await request(command, timeout_s)
        if isinstance(command, ResetStop):
            drive.lose()
            with pytest.raises(NotAvailable):
                await server.driving.stop_robots("Bert")
        return answer

    drive.request = slow
    await server.driving.reset("Anna")
    drive.start_process()
    await until_async(lambda: drive.stopped)
    assert drive.stopped.by == "Bert"


async def test_an_undelivered_stop_is_sent_to_the_next_process(drive: Any, server: Server) -> None:
    await until_async(lambda: drive.health.alive)
    drive.lose()
    with pytest.raises(NotAvailable, match="starts in the stopped state"):
        await server.driving.stop_robots("Anna")
    assert not drive.of(StopRobots)
    drive.start_process()
    await until_async(lambda: drive.stopped)
    assert drive.stopped.by == "Anna"
    # Once undone, it is not brought back.
    await server.driving.reset("Anna")
    drive.lose()
    drive.start_process()
    await asyncio.sleep(0.05)
    assert drive.stopped is None


@pytest.mark.parametrize(
    ("watchdog_s", "words"),
    [
        (2.0, "the robots' firmware stops them"),
        (None, "use the robots' own stop switch, as not every robot has reported a watchdog"),
    ],
)
async def test_a_lost_drive_process_is_reported_with_what_stops_the_robots(
    peer: Any, drive: Any, storage: Storage, watchdog_s: float | None, words: str
) -> None:
    drive.watchdog_s = watchdog_s
    peer.world, peer.robots = "simulated:lab/1", OWN
    async with started(peer, storage, drive=drive) as server:
        await until_async(lambda: all(server.driving.facts().robots.values()))
        drive.lose()
        assert words in (server.driving.facts().process.trouble or "")


async def test_the_drive_process_stops_before_the_engine(
    peer: Any, drive: Any, storage: Storage, monkeypatch: pytest.MonkeyPatch
) -> None:
    order: list[str] = []

    for name, one in (("drive", drive), ("engine", peer)):
        stop = one.stop

        async def noted(name: str = name, stop: Any = stop) -> None:
            order.append(name)
            await stop()

        monkeypatch.setattr(one, "stop", noted)
    async with started(peer, storage, drive=drive):
        pass
    assert order == ["drive", "engine"]


def test_the_newest_samples_are_numbered_and_kept() -> None:
    log = WheelLog()
    for number in range(501):
        event = WheelSpeedEvent("observer", float(number), 0.3, 0.25)
        assert log.take(event, None) is None
        sample = log.take(event, SourceInstant(41.0 + number, 2, 1))
    assert sample is not None
    rows = list(wheel_rows("run", sample))
    assert [(row.source, row.speed, row.segment, row.track_id) for row in rows] == [
        ("commanded", 0.3, 2, None),
        ("encoder", 0.25, 2, None),
    ]
    assert log.newest == 501
    assert [each.number for each in log.since(499)] == [500, 501]
    assert len(log.since(0)) == 200


async def test_a_driven_roles_command_is_written_once(
    peer: Any, drive: Any, storage: Storage
) -> None:
    async with started(peer, storage, drive=drive):
        event = peer.observe()
    seen = frame_result(event.line, event.truth)
    assert "commanded" in {row.source for row in speed_rows("run", seen)}
    assert "commanded" not in {row.source for row in speed_rows("run", seen, ["obstacle"])}
    assert "commanded" in {row.source for row in speed_rows("run", seen, ["observer"])}


def test_incidents_have_wall_clock_times_and_the_newest_twenty_stay() -> None:
    incidents = Incidents(lambda: 100.0, lambda: None)
    for number in range(25):
        incidents.take(IncidentEvent("observer", "fault", f"number {number}", 90.0, None))
    at = incidents.newest[-1].at
    ago = (datetime.now(UTC) - datetime.fromisoformat(at)).total_seconds()
    assert ago == pytest.approx(10.0, abs=2.0)
    assert len(incidents.newest) == 20
    assert incidents.newest[-1].sentence == "number 24"


def test_incidents_are_stored_with_their_run_and_deleted_with_it(storage: Storage) -> None:
    storage.open()
    record = storage.create_run(name="a", source="b", parameters={}, versions={})
    at = "2026-01-01T00:00:00.000+00:00"
    incident = IncidentRecord(record.id, at, None, "stop", "Stop.", 0.2)
    number = storage.append_incident(incident)
    assert storage.incidents(record.id) == [incident]
    known = StopMeasured(212.4, 603.1, 0.085, 0.25, 0.71)
    unknown = StopMeasured(None, None, None, None, None)
    storage.append_stop(number, "observer", known)
    storage.append_stop(number, "obstacle", unknown)
    stopped = replace(incident, stops={"observer": known, "obstacle": unknown})
    storage.append_incident(stopped)
    assert storage.incidents(record.id) == [stopped, stopped]
    with pytest.raises(StorageMissing):
        storage.append_incident(IncidentRecord("none", "t", None, "stop", "Stop.", None))
    assert storage.delete_run(record.id)
    assert storage.incidents(record.id) == []
    with pytest.raises(StorageMissing):
        storage.append_stop(number, "observer", known)


async def test_a_stop_is_stored_in_its_incidents_run_even_after_its_end(
    drive: Any, server: Server
) -> None:
    first = (await begin(server)).id
    now = time.monotonic()
    drive.publish(IncidentEvent(None, "stop", "all robots were stopped", now, 0.3))
    stopped = StoppedEvent(
        "observer", "stop", "all robots were stopped", now, now, now + 0.0124, now + 0.4,
        0.3, 0.3, 0.0612, None,
    )  # fmt: skip
    drive.publish(stopped)
    # Repeated reports, and those of unknown incidents, are ignored.
    drive.publish(replace(stopped, distance_m=5.0))
    drive.publish(replace(stopped, incident_time=now + 1.0))
    await server.runs.stop(first)
    second = (await begin(server)).id
    # This robot stood only after its run was over, and its report is nearly empty.
    late = replace(stopped, role="obstacle", zero_time=None, stood_time=None)
    drive.publish(replace(late, speed_mps=None, distance_m=float("nan")))
    drive.publish(IncidentEvent("observer", "fault", "a wheel stalled", now, None))
    (incident,) = server.driving.facts().incidents[:1]
    assert {role: plain(stop) for role, stop in incident.stops.items()} == {
        "observer": {
            "zero_ms": pytest.approx(12.4),
            "stood_ms": pytest.approx(400.0),
            "distance_m": 0.061,
            "speed_mps": 0.3,
            "separation_m": None,
        },
        "obstacle": dict.fromkeys(plain(incident.stops["observer"])),
    }
    await server.runs.stop(second)
    (kept,) = await server.runs.archive.incidents(first)
    told = {role: asdict(each) for role, each in incident.stops.items()}
    assert {role: asdict(each) for role, each in kept.stops.items()} == told
    (other,) = await server.runs.archive.incidents(second)
    assert (other.sentence, other.stops) == ("a wheel stalled", {})


async def test_wheel_speeds_are_stored_while_no_frames_arrive(
    peer: Any, drive: Any, storage: Storage, server: Server
) -> None:
    record = await begin(server)
    peer.observe()
    # Of a live source, whose clock goes on.
    server.source.time.live = True
    told = 0
    while not any(row.source == "encoder" for row in storage.speeds(record.id)):
        drive.measure("observer", 0.3, 0.25)
        told += 1
        await asyncio.sleep(0.02)
    assert told > 1


async def test_a_lease_granted_after_its_operator_left_is_released() -> None:
    asked: list[Any] = []
    answer: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()

    async def ask(command: Any) -> dict[str, Any]:
        asked.append(command)
        return await answer if isinstance(command, TakeLease) else {}

    background: list[Any] = []
    operators = Operators(ask, lambda work: background.append(asyncio.ensure_future(work)))
    operator = operators.join("Anna", lambda *_: None)
    taking = asyncio.create_task(operators.take(operator, "observer", takeover=False))
    await asyncio.sleep(0)
    operators.leave(operator)
    answer.set_result({"lease": "late"})
    await taking
    await asyncio.gather(*background)
    assert [type(command).__name__ for command in asked] == ["TakeLease", "ReleaseLease"]
    assert operators.holder("observer") is None


def test_every_operator_gets_a_unique_name() -> None:
    async def ask(_: Any) -> dict[str, Any]:
        return {}

    operators = Operators(ask, lambda _: None)
    given = ["Anna", "Anna", "Anna (4)", "Anna", None, "operator 6", "operator 6", "\x07 \n"]
    names = [operators.join(name, lambda *_: None).name for name in given]
    assert names[:2] == ["Anna", "Anna (2)"]
    assert len(set(names)) == len(given)


def test_messages_are_valid_json() -> None:
    report = RobotReport(
        RobotPhase.CONNECTED, speed_mps=float("nan"), battery_v=float("inf"), warnings=("x",)
    )
    told = json.loads(json_text(report))
    assert (told["phase"], told["speed_mps"], told["battery_v"]) == ("connected", None, None)
    assert told["warnings"] == ["x"]
    # Half a surrogate pair, which a name may contain.
    assert json.loads(json_text(replace(report, name="\ud800", speed_mps=0.5, battery_v=None)))
