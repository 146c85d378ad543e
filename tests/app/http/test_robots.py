"""Robots over REST: armed, stopped, put on ports, measured."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import pytest
from pydantic import TypeAdapter

from app.contract.commands import OpenSource
from app.contract.drive import (
    ArmRobot,
    ConnectRobot,
    DisconnectRobot,
    ResetStop,
    StopRobots,
    TakeLease,
)
from app.contract.robots import RobotsNow
from observer.rig.rig_file import read_rig

from .wire import JSON


@pytest.mark.usefixtures("connected")
async def test_robots_are_armed_stopped_and_reset(http: Any, drive: Any) -> None:
    told = (await http.get("/api/robots")).json()
    TypeAdapter(RobotsNow).validate_python(told)
    assert told["world"] == "simulated:lab/1"
    assert told["robots"]["observer"]["name"] == "the cameras' robot"
    assert told["robots"]["obstacle"] is None
    assert told["process"] == {"alive": True, "pid": 2001, "restarts": 0, "trouble": None}
    armed = await http.post("/api/robots/observer/arm", json={"lease": None})
    assert (armed.status_code, armed.json()["state"]) == (200, "armed")
    # An empty body does the same.
    assert (await http.post("/api/robots/observer/arm")).status_code == 200
    disarmed = await http.post("/api/robots/observer/disarm")
    assert (disarmed.status_code, disarmed.json()["state"]) == (200, "disarmed")
    answer = await http.post("/api/robots/obstacle/arm", json={"lease": None})
    assert answer.status_code == 409
    assert answer.json()["detail"] == "the obstacle is not connected"
    stopped = await http.post("/api/robots/stop")
    assert stopped.status_code == 200
    assert stopped.json()["stopped"]["by"] == "an operator at 127.0.0.1"
    answer = await http.post("/api/robots/observer/arm")
    assert answer.status_code == 409
    assert (await http.post("/api/robots/reset")).json()["stopped"] is None
    assert (await http.post("/api/robots/observer/arm")).status_code == 200
    assert (len(drive.of(ArmRobot)), len(drive.of(ResetStop))) == (5, 1)


async def test_refusals_of_the_drive_process_map_to_http_statuses(http: Any, drive: Any) -> None:
    for refusal, status in (("state", 409), ("input", 422), ("failure", 503)):
        drive.refuse[ArmRobot] = (refusal, "it is not so")
        answer = await http.post("/api/robots/observer/arm")
        assert answer.status_code == status
        assert "it is not so" in answer.text
    for method, path, body in (
        ("POST", "observer/arm", '{"lease": 1}'),
        ("POST", "observer/arm", '{"lese": "x"}'),
        ("POST", "driver/arm", "{}"),
        ("POST", "driver/disarm", ""),
        ("POST", "programme", '{"name": "x", "leases": {"driver": "x"}}'),
        ("POST", "programme", '{"name": "x", "repeat": 0, "leases": {}}'),
        ("POST", "programme", '{"name": "x", "repeat": NaN, "leases": {}}'),
        ("PUT", "observer/port", '{"port": ""}'),
        ("PUT", "observer/port", '{"port": "/dev/ttyUSB0", "model": "tank"}'),
        ("PUT", "observer/port", '{"port": "ttyUSB0"}'),
        ("PUT", "observer/port", '{"port": "socket://host"}'),
        ("PUT", "observer/port", '{"port": "/dev/a\\u0000b"}'),
    ):
        answer = await http.request(method, f"/api/robots/{path}", content=body, headers=JSON)
        assert answer.status_code == 422, (path, body, answer.text)
    assert (await http.post("/api/robots/stop", json={})).status_code == 200


async def test_a_stop_does_not_wait_and_survives_the_process(
    http: Any, served: Any, drive: Any, peer: Any, eventually: Any
) -> None:
    # While something else holds the server's lock, and wrong tokens are counted.
    async with served.server.shared.lock:
        async with served.anonymous(Authorization="Bearer wrong") as client:
            for _ in range(8):
                await client.post("/api/robots/stop")
        assert not drive.of(StopRobots)
        async with asyncio.timeout(5):
            answer = await http.post("/api/robots/stop")
        assert answer.status_code == 200
    assert len(drive.of(StopRobots)) == 1
    # The next process starts stopped, before it gets a robot.
    peer.world, peer.robots = "real", ()
    await http.put("/api/source", json={"source": "camera:0,1"})
    await http.put("/api/robots/observer/port", json={"port": "/dev/ttyUSB0"})
    await eventually(lambda: drive.of(ConnectRobot))
    drive.lose()
    answer = await http.post("/api/robots/stop")
    assert answer.status_code == 503
    assert "the robots' own stop switch" in answer.json()["detail"]
    told = (await http.get("/api/robots")).json()
    assert told["robots"] == {"observer": None, "obstacle": None}
    assert "reconnected, disarmed" in told["process"]["trouble"]
    assert told["stopped"]
    warnings = (await http.get("/api/status")).json()["warnings"]
    assert any("the drive process was killed" in warning for warning in warnings)
    before = len(drive.commands)
    drive.start_process()
    await eventually(lambda: drive.robots)
    kinds = [type(command) for command in drive.commands[before:]]
    assert kinds.index(StopRobots) < kinds.index(ConnectRobot)
    assert drive.stopped.by == "an operator at 127.0.0.1"
    assert (await http.get("/api/robots")).json()["process"]["restarts"] == 1


def described_gets(app: Any) -> list[str]:
    """Paths of all answers that take no name of anything."""
    paths = app.openapi()["paths"].items()
    return [path for path, methods in paths if "get" in methods and "{" not in path]


async def test_a_key_is_stored_and_never_shown(
    serve: Any,
    drive: Any,
    peer: Any,
    tmp_path: Path,
    eventually: Any,
    capfd: pytest.CaptureFixture[str],
) -> None:
    peer.world = "real"
    key = "0123456789abcdefSECRET"
    port, shown = f"external:0.0.0.0:7700?key={key}", "external:0.0.0.0:7700"

    async with serve() as served:
        http = served.http
        answers = [await http.put("/api/robots/observer/port", json={"port": port})]
        assert answers[0].json()["ports"]["observer"] == {"port": shown, "model": None}
        await eventually(lambda: drive.robots)
        assert drive.of(ConnectRobot)[-1].port == port
        # Changed on the page, which does not know the key: the key is kept.
        choice = {"port": shown, "model": "p3dx"}
        answers.append(await http.put("/api/robots/observer/port", json=choice))
        await eventually(
            lambda: drive.of(ConnectRobot)[-1] == ConnectRobot("observer", port, "p3dx", "real")
        )
        # Another address does not get the key, and the other role has no key to keep.
        for role, place in (("observer", "external:0.0.0.0:7701"), ("obstacle", shown)):
            refused = await http.put(f"/api/robots/{role}/port", json={"port": place})
            assert refused.status_code == 422
            answers.append(refused)
        assert (await http.post("/api/runs", json={"name": "With a key"})).status_code == 201
        for path in ("robots", "status", "rig", "runs", "sources"):
            answers.append(await http.get(f"/api/{path}"))
        assert (await http.get("/api/robots")).json()["robots"]["observer"]["port"] == shown
        for answer in answers:
            assert key not in answer.text, answer.url
        assert all(key not in str(c.rig_yaml) for c in peer.commands if isinstance(c, OpenSource))
        # The file is the configuration itself: it contains the key, readable by operators only.
        assert key in (await http.get("/api/rig/file")).text
        link = served.app.state.admission.sessions.links.newest.token
        async with served.anonymous(Authorization=f"Bearer {link}") as watching:
            for path in described_gets(served.app):
                told = await watching.get(path)
                assert key not in told.text, path
                assert path != "/api/rig/file" or told.is_success
    file = tmp_path / "rig.yaml"
    assert read_rig(file.read_text(), "rig.yaml").ports == {"observer": port}
    assert file.stat().st_mode & 0o777 == 0o600
    for other in tmp_path.rglob("*"):
        if other.is_file() and other != file:
            assert key.encode() not in other.read_bytes(), other
    told = capfd.readouterr()
    assert key not in told.out + told.err


async def test_a_port_is_stored_and_can_be_changed_during_a_run(
    serve: Any, drive: Any, peer: Any, tmp_path: Path, eventually: Any
) -> None:
    peer.world = "real"

    async with serve() as served:
        http = served.http
        assert (await http.post("/api/runs", json={})).status_code == 201
        opened = [c for c in peer.commands if isinstance(c, OpenSource)]
        choice = {"port": "/dev/ttyUSB0", "model": "amigo-sh"}
        answer = await http.put("/api/robots/observer/port", json=choice)
        assert answer.status_code == 200, answer.text
        assert answer.json()["ports"] == {"observer": choice, "obstacle": None}
        await eventually(lambda: drive.robots)
        assert drive.of(ConnectRobot) == [
            ConnectRobot("observer", "/dev/ttyUSB0", "amigo-sh", "real")
        ]
        rig = read_rig((tmp_path / "rig.yaml").read_text(), "rig.yaml")
        assert (rig.ports, rig.models) == ({"observer": "/dev/ttyUSB0"}, {"observer": "amigo-sh"})
        same = await http.put("/api/robots/obstacle/port", json={"port": "/dev/ttyUSB0"})
        assert same.status_code == 422
        assert "two different ports" in same.json()["detail"][0]["msg"]
        other = {"port": "socket://10.0.0.7:8101", "model": None}
        assert (await http.put("/api/robots/observer/port", json=other)).is_success
        await eventually(lambda: drive.of(ConnectRobot)[-1].port == other["port"])
        # The rig's own page leaves ports alone, and can change models during a run too.
        models = {"mount": {}, "models": {"observer": "p3dx"}}
        assert (await http.put("/api/rig", json=models)).status_code == 200
        await eventually(lambda: drive.of(ConnectRobot)[-1].model == "p3dx")
        answer = await http.delete("/api/robots/observer/port")
        assert answer.json()["ports"]["observer"] is None
        await eventually(lambda: not drive.robots)
        assert drive.of(DisconnectRobot)
        # None of this reopened the source.
        assert [c for c in peer.commands if isinstance(c, OpenSource)] == opened


async def test_concurrent_changes_of_port_and_mount_are_both_stored(
    http: Any, served: Any, tmp_path: Path
) -> None:
    async with served.server.shared.lock:
        # Both wait, as for a source that is being opened.
        port = asyncio.create_task(
            http.put("/api/robots/observer/port", json={"port": "/dev/ttyUSB0"})
        )
        await asyncio.sleep(0.1)
        mount = asyncio.create_task(
            http.put("/api/rig", json={"mount": {"height_m": {"value": 0.4}}})
        )
        await asyncio.sleep(0.1)
    assert [(await each).status_code for each in (port, mount)] == [200, 200]
    rig = read_rig((tmp_path / "rig.yaml").read_text(), "rig.yaml")
    assert rig.ports == {"observer": "/dev/ttyUSB0"}
    assert rig.mount.height_m is not None


@pytest.mark.usefixtures("connected")
async def test_wheel_speeds_are_stored_with_a_run_and_sent_to_pages(
    http: Any, served: Any, drive: Any, peer: Any
) -> None:
    async with served.socket("/api/live") as live:
        # Before the first frame the source's time is unknown.
        drive.measure("observer", 0.5, 0.5)
        started = (await http.post("/api/runs", json={})).json()
        peer.observe()
        await http.post("/api/robots/observer/arm")
        event = peer.observe()
        drive.measure("observer", 0.2, 0.18)
        drive.measure("observer", 0.3, None)
        drive.measure("observer", float("nan"), None)
        drive.measure("observer", 0.1, float("inf"))
        # Pages get them with the process's next report on the robots, which is sent all the time.
        drive.tell()
        told: list[dict[str, Any]] = []
        while len(told) < 3:
            message = json.loads(await live.recv())
            if message["type"] == "robots":
                told += message["wheels"]
        assert [each["sent_mps"] for each in told] == [0.2, 0.3, 0.1]
        assert [each["encoder_mps"] for each in told] == [0.18, None, None]
        # In the source's time, slightly after the frame.
        for each in told:
            assert each["time"] == pytest.approx(event.line["time"], abs=2.0)
            assert each["time"] >= event.line["time"]
    async with served.socket("/api/live") as later:
        while (message := json.loads(await later.recv()))["type"] != "robots":
            pass
        assert message["wheels"] == []
    ended = await http.post(f"/api/runs/{started['id']}/stop")
    assert ended.json()["state"] == "finished"
    rows = (await http.get(f"/api/runs/{started['id']}/speeds")).json()
    wheels = [row for row in rows if row["track_id"] is None]
    assert [(row["source"], row["speed"]) for row in wheels] == [
        ("commanded", 0.2),
        ("encoder", 0.18),
        ("commanded", 0.3),
        ("commanded", 0.1),
    ]
    assert {row["role"] for row in wheels} == {"observer"}
    # The command from the ground truth is for the obstacle, which is not driven.
    scripted = [row for row in rows if row["source"] == "commanded" and row["track_id"]]
    assert [row["role"] for row in scripted] == ["obstacle", "obstacle"]
    csv = (await http.get(f"/api/runs/{started['id']}/speeds?format=csv")).text
    assert ",observer,encoder,,0.18,,0" in csv


async def test_metrics_include_driving(http: Any, drive: Any) -> None:
    text = (await http.get("/metrics")).text
    assert "dynamic_observer_drive_alive 1.0" in text
    assert "dynamic_observer_drive_late_p99_ms 0.4" in text
    assert 'dynamic_observer_robot_armed{role="observer"} 0.0' in text
    drive.lose()
    text = (await http.get("/metrics")).text
    assert "dynamic_observer_drive_alive 0.0" in text
    assert "dynamic_observer_drive_late_p99_ms" not in text


async def test_without_a_drive_process_everything_else_works(serve: Any, drive: Any) -> None:
    drive.cannot_start = True

    async with serve() as served:
        status = (await served.http.get("/api/status")).json()
        (warning,) = [each for each in status["warnings"] if "robots cannot be driven" in each]
        assert "3 times in a row" in warning
        assert status["engine"]["state"] == "preview"
        assert (await served.http.post("/api/robots/observer/arm")).status_code == 503
        assert (await served.http.post("/api/robots/stop")).status_code == 503
        assert not drive.of(TakeLease)
