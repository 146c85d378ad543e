"""The whole server with its real engine and viewer, which other tests replace by peers."""

from __future__ import annotations

import asyncio
import json
import math
import os
import re
import signal
import time
from pathlib import Path
from typing import Any

import pytest

from app.drive.priority import permitted_priority
from app.http.server import create_app
from app.settings import Settings
from app.storage import Storage


@pytest.fixture
def real(tmp_path: Path, serve_app: Any, token: str) -> Any:
    """``async with real() as served``: nothing is replaced."""

    def make() -> Any:
        settings = Settings(data=tmp_path)
        return serve_app(create_app(settings, token), settings)

    return make


async def test_a_run_survives_its_engine_and_the_page_is_notified(
    real: Any, tmp_path: Path
) -> None:
    async with asyncio.timeout(100), real() as served, served.socket("/api/live") as live:
        assert (await next_obstacle(live))["speed"] >= 0
        image = await served.http.get("/api/views/left.jpg")
        assert image.content.startswith(b"\xff\xd8")

        refused = await served.http.put("/api/source", json={"source": "/no/such/folder"})
        assert refused.status_code == 422
        assert "/no/such/folder" in refused.json()["detail"][0]["msg"]
        changed = await served.http.patch(
            "/api/parameters", json={"ego_motion.ransac_threshold_px": 2.0}
        )
        assert changed.json()["frame"] > 0

        run = (await served.http.post("/api/runs", json={"name": "Killed"})).json()
        # Frames from before the run may still be in flight, and are not kept.
        while (await served.http.get(f"/api/runs/{run['id']}")).json()["frames"] == 0:
            await message(live, lambda m: m["type"] == "observation")
        pid = (await served.http.get("/api/status")).json()["engine"]["pid"]
        if permitted_priority() in ("realtime", "raised"):
            # Robots depend on it, so it has priority over other programs.
            assert os.getpriority(os.PRIO_PROCESS, pid) < 0
        os.kill(pid, signal.SIGKILL)
        killed = time.monotonic()
        told = await message(live, lambda m: m.get("engine", {}) != {} and is_failed(m))
        assert "restarting" in told["engine"]["reason"]
        back = await message(
            live, lambda m: m["type"] == "status" and m["engine"]["state"] == "running"
        )
        # The supervisor promises 2 s; this allows for a machine that runs other tests.
        assert time.monotonic() - killed < 10
        assert back["engine"]["generation"] == 2
        assert back["run"]["id"] == run["id"]
        await message(live, lambda m: m["type"] == "observation" and m["line"]["segment"] >= 1)
        ended = (await served.http.post(f"/api/runs/{run['id']}/stop")).json()
        assert ended["state"] == "finished"
        assert ended["segments"] == 2
        assert ended["parameters"]["ego_motion.ransac_threshold_px"] == 2.0
    with Storage(tmp_path / "observer.sqlite") as storage:
        (record,) = storage.list_runs()
        rows = storage.speeds(record.id)
        assert {row.segment for row in rows} == {0, 1}
        assert {"truth", "commanded"} <= {row.source for row in rows}


@pytest.mark.patient
async def test_a_run_requested_from_a_dying_engine_is_started_by_the_next(real: Any) -> None:
    async with asyncio.timeout(100), real() as served, served.socket("/api/live") as live:
        await message(live, lambda m: m["type"] == "observation")
        pid = (await served.http.get("/api/status")).json()["engine"]["pid"]
        os.kill(pid, signal.SIGSTOP)
        asking = asyncio.create_task(served.http.post("/api/runs", json={}, timeout=60))
        await asyncio.sleep(0.3)
        assert not asking.done()
        os.kill(pid, signal.SIGKILL)
        started = await asking
        assert started.status_code == 201, started.text
        await asyncio.sleep(0.5)
        ended = (await served.http.post(f"/api/runs/{started.json()['id']}/stop")).json()
        # A new engine is set up once: reopening would put the run into a second segment.
        assert (ended["state"], ended["segments"]) == ("finished", 1)


@pytest.mark.patient
async def test_a_calibration_is_previewed_on_the_newest_pair(
    real: Any, calibration_yaml: Any
) -> None:
    async with asyncio.timeout(100), real() as served, served.socket("/api/live") as live:
        await message(live, lambda m: m["type"] == "observation")
        good = await upload(served, calibration_yaml())
        preview = await served.http.get(f"/api/calibrations/{good['id']}/preview")
        assert preview.content.startswith(b"\xff\xd8")
        assert float(preview.headers["x-vertical-error-px"]) < 0.5
        used = await served.http.post(f"/api/calibrations/{good['id']}/activate")
        assert used.json()["calibration"]["id"] == good["id"]

        other = await upload(served, calibration_yaml(640, 480))
        refused = await served.http.post(f"/api/calibrations/{other['id']}/activate")
        assert refused.status_code == 422
        assert "640x480" in refused.json()["detail"][0]["msg"]
        status = (await served.http.get("/api/status")).json()
        assert status["calibration"]["id"] == good["id"]
        assert status["engine"]["state"] == "preview"


@pytest.mark.patient
async def test_a_vergence_drift_is_reported_and_offered_as_a_calibration(real: Any) -> None:
    async with asyncio.timeout(100), real() as served, served.socket("/api/live") as live:
        await open_source(served, "simulated:static_vergence")
        told = await message(live, lambda m: is_aged(m) and is_drifted(m["ageing"]["vergence"]))
        vergence = told["ageing"]["vergence"]
        # The scenario's calibration is off by -0.078 deg: the cameras converge more than it says.
        truth = math.radians(0.078)
        assert abs(vergence["vergence_rad"] - truth) < 3 * vergence["std_rad"]
        assert told["ageing"]["exposure_skew"] is None
        assert "near and far points" in vergence["sentence"]
        status = (await served.http.get("/api/status")).json()
        assert any("converge more than calibrated" in each for each in status["warnings"])

        refined = await served.http.post("/api/calibrations/refine")
        assert refined.status_code == 201, refined.text
        assert re.search(r"vergence \+0\.0[789]\d° ± 0\.0", refined.json()["origin"])
        assert (await served.http.get("/api/status")).json()["calibration"] is None


@pytest.mark.patient
async def test_an_undeclared_exposure_skew_is_reported(real: Any) -> None:
    async with asyncio.timeout(100), real() as served, served.socket("/api/live") as live:
        await open_source(served, "simulated:static_skew")
        told = await message(live, lambda m: is_aged(m) and m["ageing"]["exposure_skew"])
        skew = told["ageing"]["exposure_skew"]
        assert abs(skew["exposure_skew_s"] - 0.016) < 3 * skew["sigma_s"]
        assert "ms after the left one" in skew["sentence"]


async def open_source(served: Any, spec: str) -> None:
    opened = await served.http.put("/api/source", json={"source": spec})
    assert opened.status_code == 200, opened.text


def is_aged(heard: dict[str, Any]) -> bool:
    return heard["type"] == "status" and heard["ageing"] is not None


def is_drifted(vergence: dict[str, Any]) -> bool:
    return bool(vergence["status"] == "drifted")


async def upload(served: Any, text: str) -> dict[str, Any]:
    files = {"file": ("calibration.yaml", text, "application/yaml")}
    answer: dict[str, Any] = (await served.http.post("/api/calibrations", files=files)).json()
    return answer


def is_failed(status: dict[str, Any]) -> bool:
    return isinstance(status["engine"], dict) and status["engine"]["state"] == "failed"


async def message(socket: Any, wanted: Any) -> dict[str, Any]:
    """Return the next matching message; acknowledge observations like a page."""
    while True:
        heard: dict[str, Any] = json.loads(await socket.recv())
        if heard["type"] == "observation":
            await socket.send(json.dumps({"type": "painted", "sequence": heard["sequence"]}))
        if wanted(heard):
            return heard


async def next_obstacle(socket: Any) -> dict[str, Any]:
    seen = await message(socket, lambda m: m["type"] == "observation" and m["line"]["obstacles"])
    obstacle: dict[str, Any] = seen["line"]["obstacles"][0]
    return obstacle
