"""Sources, playback and runs over REST."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import Any

from app.contract.commands import SetPlayback, StopRun
from app.storage import Storage

THRESHOLD = "ego_motion.ransac_threshold_px"


async def test_a_locked_database_is_answered_with_503(http: Any, peer: Any, tmp_path: Path) -> None:
    lock = sqlite3.connect(tmp_path / "observer.sqlite", isolation_level=None)
    lock.execute("BEGIN IMMEDIATE")
    try:
        for path, body in (("/api/runs", {}), ("/api/presets", {"name": "x"})):
            answer = await http.post(path, json=body)
            assert answer.status_code == 503, answer.text
            assert "locked" in answer.json()["detail"]
            assert answer.headers["retry-after"]
        assert peer.opened.run_id is None
        # Reading, observing and changing still work.
        assert (await http.get("/api/runs")).json() == []
        assert (await http.patch("/api/parameters", json={THRESHOLD: 5})).is_success
    finally:
        lock.execute("ROLLBACK")
        lock.close()
    assert (await http.post("/api/runs", json={})).status_code == 201


async def test_a_source_is_listed_chosen_and_remembered(http: Any, peer: Any) -> None:
    assert peer.opened.source == "simulated:lab"
    sources = (await http.get("/api/sources")).json()
    assert sources[0]["spec"] == "simulated:lab"
    assert {entry["group"] for entry in sources} == {
        "simulated", "cameras", "recordings", "folders",
    }  # fmt: skip
    answer = await http.put("/api/source", json={"source": "some/folder"})
    assert answer.json()["source"]["spec"] == "some/folder"
    opened = (await http.get("/api/sources")).json()[0]
    assert (opened["spec"], opened["title"], opened["recent"]) == ("some/folder", "folder", 0)
    # A missing folder and sources that were never listed have no picture.
    for spec in ("some/folder", "/etc", "camera:LEFT,RIGHT"):
        answer = await http.get("/api/sources/picture.jpg", params={"spec": spec})
        assert answer.status_code == 404, spec
    assert peer.opened.loop is True
    refused = await http.put("/api/source", json={"source": "missing"})
    assert refused.status_code == 422
    assert refused.json()["detail"][0]["loc"] == ["body", "source"]
    assert (await http.get("/api/status")).json()["source"]["spec"] == "some/folder"
    assert all(entry["spec"] != "missing" for entry in (await http.get("/api/sources")).json())


async def test_playback_commands_reach_the_engine(http: Any, peer: Any) -> None:
    answer = await http.post("/api/playback", json={"paused": True, "step": 2})
    assert answer.json()["paused"] is True
    assert peer.commands[-1] == SetPlayback(paused=True, step=2)
    peer.lose()
    assert (await http.post("/api/playback", json={})).status_code == 503


async def test_a_run_from_start_to_csv(http: Any, peer: Any) -> None:
    body = {"name": "First", "preset": "paper", "parameters": {THRESHOLD: 2.0}}
    started = await http.post("/api/runs", json=body)
    assert started.status_code == 201, started.text
    id = started.json()["id"]
    assert started.json()["state"] == "running"
    assert started.json()["parameters"]["matching.method"] == "descriptor"
    assert peer.opened.run_id == id
    assert peer.opened.parameters[THRESHOLD] == 2.0
    assert (await http.get("/api/parameters")).json()["values"][THRESHOLD] == 2.0
    for _ in range(20):
        peer.observe()
    status = (await http.get("/api/status")).json()
    assert status["run"]["id"] == id
    assert (await http.post("/api/runs", json={})).status_code == 409
    other = await http.put("/api/source", json={"source": "x"})
    assert other.status_code == 409
    assert (await http.delete(f"/api/runs/{id}")).status_code == 409
    assert (await http.get(f"/api/runs/{id}")).json()["frames"] == 20

    stopped = await http.post(f"/api/runs/{id}/stop")
    assert stopped.json()["state"] == "finished"
    assert stopped.json()["frames"] == 20
    assert stopped.json()["ended_at"]
    assert (await http.post(f"/api/runs/{id}/stop")).status_code == 409
    assert (await http.get("/api/status")).json()["run"] is None

    rows = (await http.get(f"/api/runs/{id}/speeds")).json()
    assert {row["source"] for row in rows} == {"estimate", "truth", "commanded"}
    assert len(rows) == 60
    answer = await http.get(f"/api/runs/{id}/speeds", params={"format": "csv"})
    assert answer.headers["content-type"].startswith("text/csv")
    lines = answer.text.splitlines()
    assert lines[0] == "time,role,source,track_id,speed,std,segment"
    assert lines[1] == "0.0,obstacle,estimate,7,0.4,0.05,0"
    assert lines[2] == "0.0,obstacle,truth,1,0.4,,0"
    assert len(lines) == 61
    assert (await http.get(f"/api/runs/{id}/speeds?format=xml")).status_code == 422

    assert [r["id"] for r in (await http.get("/api/runs")).json()] == [id]
    assert (await http.delete(f"/api/runs/{id}")).status_code == 204
    assert (await http.get(f"/api/runs/{id}")).status_code == 404
    assert (await http.get(f"/api/runs/{id}/speeds")).status_code == 404
    assert (await http.delete(f"/api/runs/{id}")).status_code == 404


async def test_a_run_whose_source_is_refused_is_not_stored(http: Any, peer: Any) -> None:
    answer = await http.post("/api/runs", json={"source": "missing"})
    assert answer.status_code == 422
    assert (await http.get("/api/runs")).json() == []
    status = (await http.get("/api/status")).json()
    assert status["run"] is None
    assert status["source"]["spec"] == "simulated:lab"
    assert not any(isinstance(command, StopRun) for command in peer.commands)


async def test_the_list_of_runs_states_how_many_it_returns(http: Any, storage: Storage) -> None:
    for number in range(201):
        storage.create_run(name=str(number), source="s", parameters={}, versions={})
    listed = (await http.get("/api/runs")).json()
    described = (await http.get("/openapi.json")).json()["paths"]["/api/runs"]["get"]
    assert f"at most {len(listed)}" in described["description"]
    assert listed[0]["name"] == "200"
    assert (await http.get("/api/history")).json()["total"] == 201
