"""The guided check over REST, from its beginning to its record."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from pydantic import TypeAdapter

from app.contract.robots import CheckNow, ChecksNow, RobotsNow
from observer.robots.contract import RobotPort


@pytest.fixture(autouse=True)
def world(peer: Any) -> None:
    peer.world = "simulated:lab/1"
    peer.robots = (RobotPort("observer", "socket://127.0.0.1:5001", "amigo-sh", "amigo"),)


async def test_a_check_proceeds_step_by_step_to_a_record(
    http: Any, served: Any, drive: Any, eventually: Any, tmp_path: Path
) -> None:
    await eventually(lambda: drive.robots)
    now = (await http.get("/api/robots/check")).json()
    assert now["check"] is None
    assert "not been checked yet" in now["advice"]
    started = await http.post("/api/robots/check", json={"name": "Anna", "note": "new lens"})
    assert started.status_code == 201
    TypeAdapter(CheckNow).validate_python(started.json())
    assert started.json()["started_by"] == "Anna (127.0.0.1)"
    assert (await http.post("/api/robots/check")).status_code == 409
    drive.leases["observer"] = ("lease", "Ben")
    drive.tell()
    drive.come_to_rest("observer", "guard", "obstacle 7 is too near", separation_m=0.4)
    drive.come_to_rest("observer", "expired", "no command came in time")
    skipped = await http.post("/api/robots/check/skip", json={"name": "Anna"})
    assert (skipped.status_code, skipped.json()["present"]) == (200, 2)
    assert (await http.post("/api/robots/check/skip")).json()["present"] == 3
    robots = (await http.get("/api/robots")).json()
    TypeAdapter(RobotsNow).validate_python(robots)
    assert "not sight" in robots["check"]["steps"][1]["told"]
    assert robots["check"]["steps"][0]["figures"]["zero_ms"] == pytest.approx(200, abs=1)
    # Any stop of a moving robot is measured, whether or not a check is running.
    stops = robots["incidents"][0]["stops"]
    assert stops["observer"]["separation_m"] == 0.4
    assert stops["observer"]["stood_ms"] == pytest.approx(500, abs=1)
    drive.come_to_rest("observer", "lease", "its operator is gone")
    await eventually(lambda: served.server.driving.facts().check.record)
    now = (await http.get("/api/robots/check")).json()
    TypeAdapter(ChecksNow).validate_python(now)
    assert now["check"]["outcome"] == "incomplete"
    assert now["advice"] == "Check again: steps of the latest check were skipped."
    name = now["check"]["record"]
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d{4}-observer", name)
    (entry,) = (await http.get("/api/robots/checks")).json()
    assert (entry["name"], entry["note"]) == (name, "new lens")
    answer = await http.get(f"/api/robots/checks/{name}")
    assert answer.headers["content-disposition"] == f'attachment; filename="{name}.json"'
    record = answer.json()
    assert record == json.loads((tmp_path / "guard-checks" / f"{name}.json").read_text())
    assert record["steps"][1]["skipped_by"] == "Anna (127.0.0.1)"
    assert record["steps"][3]["operator"] == "Ben"
    assert record["robot"]["watchdog_s"] == 2.0
    assert record["guard"]["guard.margin_m"] == 0.08
    answer = await http.get(f"/api/robots/checks/{name}", params={"format": "markdown"})
    assert answer.headers["content-type"].startswith("text/markdown")
    assert answer.text.startswith("# Guard check, observer")
    # A new check may begin; if it is given up, it is recorded as such.
    assert (await http.post("/api/robots/check")).status_code == 201
    gone = await http.delete("/api/robots/check", params={"name": "Ben"})
    assert (gone.status_code, gone.json()["outcome"]) == (200, "given_up")
    assert gone.json()["given_up_by"] == "Ben (127.0.0.1)"
    assert (await http.delete("/api/robots/check")).status_code == 409
    listed = (await http.get("/api/robots/checks")).json()
    assert [each["outcome"] for each in listed] == ["given_up", "incomplete"]


async def test_invalid_requests_are_refused_with_a_reason(
    http: Any, served: Any, drive: Any, eventually: Any, tmp_path: Path
) -> None:
    await eventually(lambda: drive.robots)
    (tmp_path / "canary.json").write_text('{"secret": 1}')
    answer = await http.post("/api/robots/check", json={"role": "obstacle"})
    assert (answer.status_code, answer.json()["detail"]) == (
        409, "no robot is connected as the obstacle",
    )  # fmt: skip
    for call in (http.post("/api/robots/check/skip"), http.delete("/api/robots/check")):
        answer = await call
        assert (answer.status_code, answer.json()["detail"]) == (
            409, "no check is in progress; start one first",
        )  # fmt: skip
    for body in (
        '{"role": "driver"}', '{"note": 3}', '{"name": ""}', '{"nme": "x"}', "[]",
        '{"name": "a\\u0000"}', json.dumps({"note": "x" * 501}),
    ):  # fmt: skip
        answer = await http.post(
            "/api/robots/check", content=body, headers={"Content-Type": "application/json"}
        )
        assert answer.status_code == 422, body
    assert served.server.driving.facts().check is None
    for name in (
        "..%2fcanary", "%2e%2e%2fcanary", "..%5ccanary", "canary", "a%00b", "%2fetc%2fpasswd",
        "2026-11-22T0209-observer", "2026-11-22T0209-observer%0a", "x" * 101,
    ):  # fmt: skip
        answer = await http.get(f"/api/robots/checks/{name}")
        assert answer.status_code in (400, 404, 422), name
        assert "secret" not in answer.text
    answer = await http.get("/api/robots/checks/left", params={"format": "exe"})
    assert answer.status_code == 422
    assert (await http.get("/api/robots/check", params={"role": "x"})).status_code == 422
