"""Programmes over REST, and runs that drive one."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from app.contract.commands import OpenSource
from app.contract.drive import (
    ArmRobot,
    ConnectRobot,
    StartProgramme,
    StopProgramme,
)
from app.contract.events import EngineState, StateEvent
from observer.motion_profiles.library import profile_names
from observer.robots.contract import RobotPort

OWN = """
name: to_and_fro
title: To and fro
help: There and back.
steps:
  observer:
    - {seconds: 2, speed_mps: 0.2}
    - {seconds: 2, speed_mps: -0.2}
"""


async def arm_with_programme(http: Any, drive: Any) -> None:
    """Save the programme and arm the observer for Anna."""
    assert (await http.post("/api/programmes", json={"text": OWN})).status_code == 201
    drive.leases["observer"] = ("lease", "Anna")
    await http.post("/api/robots/observer/arm", json={"lease": "lease"})


async def start_held_run(http: Any, peer: Any) -> tuple[asyncio.Task[Any], asyncio.Event]:
    """Start a run with the programme; its source opens only once the event is set."""
    opening, go_on = hold_opening(peer)
    wanted = {"programme": {"name": "to_and_fro", "leases": {"observer": "lease"}}}
    starting = asyncio.create_task(http.post("/api/runs", json=wanted))
    await opening.wait()
    return starting, go_on


@pytest.mark.usefixtures("connected")
async def test_programmes_are_listed_stored_driven_and_deleted(
    http: Any, drive: Any, tmp_path: Path
) -> None:
    listed = (await http.get("/api/programmes")).json()
    assert [each["name"] for each in listed] == list(profile_names())
    assert not any(each["own"] for each in listed)
    built_in = listed[0]["name"]
    detail = (await http.get(f"/api/programmes/{built_in}")).json()
    assert "steps:" in detail["text"]
    kept = await http.post("/api/programmes", json={"text": OWN})
    assert kept.status_code == 201, kept.text
    own = {**kept.json()}
    assert (own["own"], own["roles"], own["duration_s"]) == (True, ["observer"], 4.0)
    listed = (await http.get("/api/programmes")).json()
    assert listed[-1] == {key: own[key] for key in listed[-1]}
    assert (tmp_path / "programmes" / "to_and_fro.yaml").read_text() == OWN
    for text, status in (
        (OWN.replace("to_and_fro", built_in), 409),
        (OWN.replace("to_and_fro", "../x"), 422),
        (OWN.replace("seconds: 2", "seconds: .inf"), 422),
        ("a: &a [x]\nsteps: *a", 422),
        ("x" * 200_001, 422),
    ):
        answer = await http.post("/api/programmes", json={"text": text})
        assert answer.status_code == status, (text[:60], answer.text[:200])
    wanted = {"name": "to_and_fro", "repeat": 3, "reverse": True, "leases": {"observer": "l"}}
    answer = await http.post("/api/robots/programme", json=wanted)
    assert (answer.status_code, answer.json()["detail"]) == (409, "the observer is not armed")
    await http.post("/api/robots/observer/arm")
    answer = await http.post("/api/robots/programme", json=wanted)
    assert answer.status_code == 200
    assert answer.json()["programme"]["name"] == "to_and_fro"
    start = drive.of(StartProgramme)[-1]
    assert (start.repeat, start.reverse, start.leases) == (3, True, {"observer": "l"})
    assert (await http.delete("/api/robots/programme")).json()["programme"] is None
    unknown = {**wanted, "name": "none"}
    assert (await http.post("/api/robots/programme", json=unknown)).status_code == 404
    for name, status in ((built_in, 409), ("to_and_fro", 204), ("to_and_fro", 404)):
        assert (await http.delete(f"/api/programmes/{name}")).status_code == status
    for name in ("..%2Fobserver", "%2e%2e", ".hidden", "rig"):
        assert (await http.get(f"/api/programmes/{name}")).status_code == 404


@pytest.mark.usefixtures("connected")
async def test_a_run_starts_and_ends_with_its_programme(http: Any, served: Any, drive: Any) -> None:
    wanted = {"programme": {"name": "to_and_fro", "leases": {"observer": "lease"}}}
    assert (await http.post("/api/runs", json=wanted)).status_code == 404
    assert (await http.post("/api/programmes", json={"text": OWN})).status_code == 201
    # If the programme cannot begin, the run does not begin either.
    answer = await http.post("/api/runs", json=wanted)
    assert (answer.status_code, answer.json()["detail"]) == (
        409,
        "the observer is not armed; arm it first",
    )
    assert (await http.get("/api/runs")).json() == []
    assert served.server.source.state.state.value == "preview"
    drive.leases["observer"] = ("lease", "Anna")
    await http.post("/api/robots/observer/arm", json={"lease": "lease"})
    started = await http.post("/api/runs", json=wanted)
    assert started.status_code == 201, started.text
    assert drive.programme is not None
    assert served.server.source.state.state.value == "running"
    drive.come_to_rest("observer", "fault", "the observer's left wheel stalled")
    await http.post(f"/api/runs/{started.json()['id']}/stop")
    assert drive.programme is None
    assert len(drive.of(StopProgramme)) == 1
    # Whatever stopped a robot is kept with the run, and shown.
    path = f"/api/runs/{started.json()['id']}/incidents"
    (incident,) = (await http.get(path)).json()
    assert incident["sentence"] == "the observer's left wheel stalled"
    assert (incident["kind"], incident["speed_mps"]) == ("fault", 0.25)
    shown = (await http.get("/api/robots")).json()["incidents"]
    assert shown == [incident]
    assert incident["stops"] == {
        "observer": {
            "zero_ms": 200.0,
            "stood_ms": 500.0,
            "distance_m": 0.09,
            "speed_mps": 0.25,
            "separation_m": None,
        }
    }
    assert (await http.get("/api/runs/none/incidents")).status_code == 404


@pytest.mark.usefixtures("connected")
async def test_a_run_restarts_a_simulated_world_and_rearms_its_robots(
    http: Any, served: Any, drive: Any, peer: Any
) -> None:
    await arm_with_programme(http, drive)
    peer.world = "simulated:lab/2"
    peer.robots = (RobotPort("observer", "socket://127.0.0.1:5009", "amigo-sh", "the same again"),)
    wanted = {"name": "to_and_fro", "leases": {"observer": "lease"}}
    started = await http.post("/api/runs", json={"programme": wanted})
    assert started.status_code == 201, started.text
    kinds = (ConnectRobot, ArmRobot, StartProgramme)
    assert [type(command) for command in drive.of(*kinds)[-3:]] == list(kinds)
    assert drive.of(ArmRobot)[-1].lease == "lease"
    assert drive.robots["observer"].world == "simulated:lab/2"
    await http.post(f"/api/runs/{started.json()['id']}/stop")
    # A stop in between stays in force.
    peer.robots = (RobotPort("observer", "socket://127.0.0.1:5010", "amigo-sh", "x"),)
    drive.stops_at_connecting = True
    answer = await http.post("/api/runs", json={"programme": wanted})
    assert answer.status_code == 409
    assert "stopped" in answer.json()["detail"]
    assert served.server.runs.current is None


@pytest.mark.usefixtures("connected")
@pytest.mark.parametrize("replaced", [True, False])
@pytest.mark.parametrize("requests", [("observer/disarm",), ("stop", "reset")])
async def test_a_robot_disarmed_while_a_run_starts_stays_disarmed(
    http: Any, served: Any, drive: Any, peer: Any, requests: tuple[str, ...], *, replaced: bool
) -> None:
    await arm_with_programme(http, drive)
    armings = len(drive.of(ArmRobot))
    if replaced:
        peer.world = "simulated:lab/2"
        peer.robots = (RobotPort("observer", "socket://127.0.0.1:5009", "amigo-sh", "x"),)
    starting, go_on = await start_held_run(http, peer)
    for request in requests:
        assert (await http.post(f"/api/robots/{request}")).status_code == 200
    go_on.set()
    answer = await starting
    assert (answer.status_code, answer.json()["detail"]) == (
        409,
        "the observer was disarmed while the run was starting; arm it, then start the run again",
    )
    assert served.server.runs.current is None
    assert "observer" not in drive.armed
    assert len(drive.of(ArmRobot)) == armings
    assert not drive.of(StartProgramme)


@pytest.mark.usefixtures("connected")
async def test_a_robot_that_disarms_itself_while_a_run_starts_stays_disarmed(
    http: Any, drive: Any, peer: Any
) -> None:
    await arm_with_programme(http, drive)
    starting, go_on = await start_held_run(http, peer)
    # As after a fault; its connection stays.
    drive.armed.clear()
    drive.tell()
    go_on.set()
    answer = await starting
    assert answer.status_code == 409
    assert "was disarmed while the run was starting" in answer.json()["detail"]
    assert "observer" not in drive.armed


@pytest.mark.usefixtures("connected")
async def test_a_robot_that_reopening_the_source_reconnected_is_rearmed(
    http: Any, drive: Any, peer: Any, eventually: Any
) -> None:
    await arm_with_programme(http, drive)
    starting, go_on = await start_held_run(http, peer)
    # As for a source of which only one can be open: it is closed first, then opened again.
    peer.publish(StateEvent(EngineState.IDLE, None))
    await eventually(lambda: not drive.robots)
    go_on.set()
    answer = await starting
    assert answer.status_code == 201, answer.text
    assert [type(command) for command in drive.commands[-3:]] == [
        ConnectRobot,
        ArmRobot,
        StartProgramme,
    ]


def hold_opening(peer: Any) -> tuple[asyncio.Event, asyncio.Event]:
    """Have the engine open nothing until the second event is set; it sets the first one."""
    opening, go_on, request = asyncio.Event(), asyncio.Event(), peer.request

    async def held(command: Any, *args: Any, **more: Any) -> Any:
        if isinstance(command, OpenSource):
            opening.set()
            await go_on.wait()
        return await request(command, *args, **more)

    peer.request = held
    return opening, go_on
