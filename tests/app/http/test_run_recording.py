"""A run's recording over REST: ordered, shown, fed by robots, downloaded, deleted with the run."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from app.contract.commands import RecordRobots, SaveClip
from app.contract.drive import IncidentEvent
from app.contract.events import EngineState
from app.contract.robots import RobotNow, Velocity
from app.server.runs import saved_clips
from observer.robots.contract import RobotPhase, RobotReport
from observer.types import Odometry

CONTENT = b"\x89MCAP0\r\n and so on"


async def test_a_run_is_recorded_and_its_recording_is_downloadable(
    http: Any, peer: Any, tmp_path: Path
) -> None:
    started = (await http.post("/api/runs", json={"record": "lossless"})).json()
    id, path = started["id"], f"/api/runs/{started['id']}/recording"
    order = peer.opened.record
    file = tmp_path / "runs" / id / "recording.mcap"
    assert (order.path, order.images) == (str(file), "lossless")
    assert started["record"] == "lossless"
    assert (await http.get("/api/status")).json()["recording"] is None
    peer.publish(peer.state(recording=peer.recording(bytes=77)))
    status = (await http.get("/api/status")).json()
    assert status["recording"]["bytes"] == 77
    trouble = "the recording ended because the disk is full"
    peer.publish(peer.state(recording=peer.recording(trouble=trouble)))
    assert trouble in (await http.get("/api/status")).json()["warnings"]

    file.parent.mkdir(parents=True)
    file.write_bytes(CONTENT)
    going = await http.get(path)
    assert (going.status_code, "in progress" in going.json()["detail"]) == (409, True)
    stopped = (await http.post(f"/api/runs/{id}/stop")).json()
    assert stopped["recording_bytes"] == 4096
    answer = await http.get(path)
    assert answer.content == CONTENT
    assert 'filename="The lab.mcap"' in answer.headers["content-disposition"]
    part = await http.get(path, headers={"Range": "bytes=1-4"})
    assert (part.status_code, part.content) == (206, b"MCAP")
    beyond = await http.get(path, headers={"Range": "bytes=999-"})
    assert beyond.status_code == 416
    for invalid in ("bytes=5-2", "bytes=a-b", "bytes=", "lines=1-4", "bytes=1-4,9-3", "bytes"):
        whole = await http.get(path, headers={"Range": invalid})
        assert (whole.status_code, whole.content) == (200, CONTENT), invalid
    asked = await http.head(path)
    assert (asked.status_code, asked.content) == (200, b"")
    assert asked.headers["content-length"] == str(len(CONTENT))
    tag = answer.headers["etag"]
    for known in (tag, f'"another", W/{tag}', "*", f'"with, comma",W/{tag}'):
        for ask in (http.get, http.head):
            kept = await ask(path, headers={"If-None-Match": known})
            assert (kept.status_code, kept.content) == (304, b""), known
            assert kept.headers["etag"] == tag
    assert (await http.get(path, headers={"If-None-Match": '"another"'})).content == CONTENT
    assert (await http.delete(f"/api/runs/{id}")).status_code == 204
    assert (await http.get(path)).status_code == 404
    # The run can be recovered until it is purged.
    assert file.exists()


async def test_a_run_without_a_recording_says_so(http: Any, peer: Any) -> None:
    id = (await http.post("/api/runs", json={})).json()["id"]
    assert peer.opened.record.images == "jpeg"
    await http.post(f"/api/runs/{id}/stop")
    answer = await http.get(f"/api/runs/{id}/recording")
    assert (answer.status_code, "no recording" in answer.json()["detail"]) == (404, True)
    refused = await http.post("/api/runs", json={"record": "everything"})
    assert refused.status_code == 422


async def test_a_full_disk_is_answered_with_507(http: Any, peer: Any) -> None:
    answer = await http.post("/api/runs", json={"source": "no room"})
    assert answer.status_code == 507
    assert "3 MB are left" in answer.json()["detail"]
    assert (await http.get("/api/runs")).json() == []
    assert peer.opened.source == "simulated:lab"


async def test_a_run_continues_its_recording_with_the_next_engine(
    served: Any, peer: Any, eventually: Any
) -> None:
    await served.http.post("/api/runs", json={})
    first = peer.opened.record
    peer.lose()
    peer.start_process()
    await eventually(lambda: peer.opened is not None and peer.opened.segment == 1)
    assert peer.opened.record == first
    await eventually(lambda: served.server.source.state.state is EngineState.RUNNING)


async def test_robot_data_are_sent_for_the_recording(
    served: Any, peer: Any, drive: Any, eventually: Any
) -> None:
    await served.http.post("/api/runs", json={})
    peer.observe()
    received = served.server.source.latest.received
    time = served.server.source.latest.line["time"]
    report = RobotReport(
        RobotPhase.CONNECTED,
        received=received + 0.2,
        odometry=Odometry(1.0, 2.0, 0.5),
        speed_mps=0.2,
        turn_rate_radps=0.1,
        battery_v=12.5,
    )
    sent = Velocity(0.3, 0.0)
    robot = RobotNow(
        "port", "Robbie", "real", "moving", "Ann", True, None, sent, sent, None, report
    )
    for _ in range(3):
        drive.tell(robots={"observer": robot, "obstacle": None})
    drive.publish(IncidentEvent("observer", "guard", "it stopped", 7.0, 0.3))

    def told() -> RecordRobots | None:
        return next((c for c in peer.commands if isinstance(c, RecordRobots)), None)

    await eventually(told)
    command = told()
    assert command is not None
    # Reported three times, but recorded once.
    assert len(command.rows) == 1
    row = command.rows[0]
    assert (row.role, row.sent_speed, row.encoder_speed) == ("observer", 0.3, 0.2)
    assert (row.x, row.y, row.yaw) == (1.0, 2.0, 0.5)
    assert abs(row.time - time - 0.2) < 1e-6
    assert [(i.kind, i.received) for i in command.incidents] == [("guard", 7.0)]


async def test_the_last_half_minute_is_saved_with_the_run(
    http: Any, peer: Any, tmp_path: Path
) -> None:
    refused = await http.post("/api/recording/clips")
    assert (refused.status_code, refused.json()["detail"]) == (
        409, "the open source can simply be replayed",
    )  # fmt: skip
    assert Path(peer.commands[-1].path).parent == tmp_path / "clips"
    id = (await http.post("/api/runs", json={})).json()["id"]
    saved = await http.post("/api/recording/clips")
    assert saved.status_code == 201
    path = Path(peer.commands[-1].path)
    assert path.parent == tmp_path / "runs" / id
    assert saved.json() == {
        "file": str(path.relative_to(tmp_path)), "bytes": 512, "seconds": 29.9,
    }  # fmt: skip


async def test_saved_half_minutes_are_listed_downloaded_and_deleted(
    served: Any, tmp_path: Path
) -> None:
    alone = "clip-20261121-235959-000001"
    former = "ring-20261120-120000-000000"
    of_a_run = "clip-20261122-081500-123456"
    for place, name in (
        ("clips", alone), ("rings", former), ("runs/2026-a", of_a_run),
        ("runs/2026-a", "recording"), ("clips", "clip-mine"),
        ("clips", "clip-20261399-000000-000000"), ("runs/.gone", alone),
    ):  # fmt: skip
        file = tmp_path / place / f"{name}.mcap"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(CONTENT)

    http, path = served.http, "/api/recording/clips"
    newest, middle, oldest = (await http.get(path)).json()
    file = tmp_path / "runs" / "2026-a" / f"{of_a_run}.mcap"
    assert newest == {
        "name": of_a_run, "run_id": "2026-a", "saved_at": "2026-11-22T08:15:00.123456+00:00",
        "bytes": len(CONTENT), "source": str(file),
    }  # fmt: skip
    assert (middle["name"], middle["run_id"]) == (alone, None)
    assert (oldest["name"], oldest["run_id"]) == (former, None)
    answer = await http.get(f"{path}/{of_a_run}")
    assert answer.content == CONTENT
    assert f'filename="{of_a_run}.mcap"' in answer.headers["content-disposition"]
    for none in ("recording", "clip-mine", "..%2Frecording", "%2e%2e"):
        assert (await http.get(f"{path}/{none}")).status_code == 404
        assert (await http.delete(f"{path}/{none}")).status_code in (404, 405)
    assert (await http.delete(f"{path}/{of_a_run}")).status_code == 204
    gone = await http.delete(f"{path}/{of_a_run}")
    assert (gone.status_code, "no saved clip" in gone.json()["detail"]) == (404, True)
    assert [each["name"] for each in (await http.get(path)).json()] == [alone, former]
    assert sorted(each.name for each in file.parent.iterdir()) == ["recording.mcap"]


@pytest.mark.parametrize("automatic", [True, False])
async def test_a_guard_stop_saves_the_last_half_minute_once(
    serve: Any, peer: Any, drive: Any, eventually: Any, monkeypatch: Any, automatic: bool
) -> None:
    monkeypatch.setattr(saved_clips, "_BEHIND_STOP_S", 0.05)
    async with serve(clips_at_guard_stops=automatic) as served:
        await served.http.post("/api/runs", json={})
        for kind in ("stop", "guard", "guard"):
            drive.publish(IncidentEvent("observer", kind, "it stopped", 7.0, 0.3))

        def saves() -> int:
            return sum(isinstance(command, SaveClip) for command in peer.commands)

        if automatic:
            await eventually(saves)
        await asyncio.sleep(0.2)
        assert saves() == int(automatic)
