"""Two methods compared on identical frames, and the frames of a run over REST."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from observer.recording.reader import Recording
from observer.robots.contract import RobotPort

_SECONDS = 1.0
_FRAMES = 15


async def _compared(http: Any, **wanted: Any) -> dict[str, Any]:
    """Start a comparison, and wait for its end."""
    started = await http.post("/api/comparison", json={"seconds": _SECONDS, **wanted})
    assert started.status_code == 202, started.text
    async with asyncio.timeout(60):
        while (facts := (await http.get("/api/comparison")).json())["going"]:
            await asyncio.sleep(0.05)
    return dict(facts)


def _recording(folder: Path, run: str) -> Path:
    return folder / "runs" / run / "recording.mcap"


async def test_both_methods_process_the_same_frames(http: Any, peer: Any, tmp_path: Path) -> None:
    facts = await _compared(http, source="simulated:people_across")
    assert facts["trouble"] is None
    paper, default = facts["runs"]
    runs = [(await http.get(f"/api/runs/{id}")).json() for id in (paper, default)]
    assert [run["name"] for run in runs] == [
        "A person walks across, paper",
        "A person walks across, default",
    ]
    assert [run["preset"] for run in runs] == ["paper", "default"]
    assert [run["parameters"]["ego_motion.model"] for run in runs] == ["affine", "rigid"]
    assert [run["rerun_of"] for run in runs] == [None, paper]
    assert all(run["state"] == "finished" and run["frames"] == _FRAMES for run in runs)
    assert all(run["tags"] == ["comparison"] and run["calibration_id"] for run in runs)
    # The open source is left alone.
    assert peer.opened.source == "simulated:lab"
    assert (await http.get("/api/parameters")).json()["preset"] == "default"
    assert not list(tmp_path.glob(".work-*"))

    found = [(await http.get(f"/api/runs/{id}/frames")).json() for id in (paper, default)]
    assert [len(each["frames"]) for each in found] == [_FRAMES] * 2
    assert [e["time"] for e in found[0]["frames"]] == [e["time"] for e in found[1]["frames"]]
    assert all(each["truth"] and each["observed_ms"] > 0 for each in found)
    for id, each in zip((paper, default), found, strict=True):
        rows = (await http.get(f"/api/runs/{id}/speeds")).json()
        reported = sum(len(entry["obstacles"]) for entry in each["frames"])
        assert sum(row["source"] == "estimate" for row in rows) == reported
        assert sum(row["source"] == "truth" for row in rows) >= _FRAMES
        with Recording(_recording(tmp_path, id)) as recording:
            assert recording.facts.id == id
            assert recording.facts.name == f"A person walks across, {recording.facts.preset}"

    # The re-run uses the images of the original run.
    images = [(await http.get(f"/api/runs/{id}/frames/7.jpg")) for id in (paper, default)]
    assert images[0].content == images[1].content
    shown = cv2.imdecode(np.frombuffer(images[0].content, np.uint8), cv2.IMREAD_COLOR)
    assert shown is not None
    assert shown.shape[:2] == (found[0]["height"], found[0]["width"])
    with Recording(_recording(tmp_path, paper)) as recording:
        left, _ = recording.pair(7)
    grey = cv2.cvtColor(shown, cv2.COLOR_BGR2GRAY)
    assert np.abs(grey.astype(int) - (left if left.ndim == 2 else left.mean(2))).mean() < 3


async def test_frames_cached_by_the_worker_match_those_of_the_command(
    http: Any, tmp_path: Path
) -> None:
    facts = await _compared(http, source="simulated:people_across")
    for id in facts["runs"]:
        kept = (await http.get(f"/api/runs/{id}/frames")).json()
        (file,) = (tmp_path / "runs" / id).glob(".frames-*.json")
        file.unlink()
        assert (await http.get(f"/api/runs/{id}/frames")).json() == kept

    # A cancelled comparison does not report the runs of the one before.
    wanted = {"source": "simulated:people_across", "seconds": 30}
    assert (await http.post("/api/comparison", json=wanted)).json()["runs"] is None
    assert (await http.post("/api/comparison/cancel")).json()["runs"] is None


async def test_a_comparison_can_be_cancelled(http: Any, tmp_path: Path) -> None:
    wanted = {"source": "simulated:people_across", "seconds": 30}
    assert (await http.post("/api/comparison", json=wanted)).status_code == 202
    second = await http.post("/api/comparison", json=wanted)
    assert second.status_code == 409
    assert "already" in second.json()["detail"]
    facts = (await http.post("/api/comparison/cancel")).json()
    assert (facts["going"], facts["trouble"], facts["runs"]) == (None, None, None)
    assert (await http.get("/api/runs")).json() == []
    assert not list(tmp_path.glob(".work-*"))


@pytest.mark.parametrize(
    ("wanted", "place", "words"),
    [
        ({"source": "camera:0,1"}, "source", "open live cameras"),
        ({"source": "coppeliasim:localhost:23000"}, "source", "open live cameras"),
        ({"presets": ["paper", "mine"]}, "preset", "no preset"),
        ({"presets": ["paper"]}, "presets", "at least 2"),
        ({"seconds": 0.1}, "seconds", "at least 1"),
    ],
)
async def test_an_invalid_comparison_is_refused(
    http: Any, wanted: dict[str, Any], place: str, words: str
) -> None:
    answer = await http.post("/api/comparison", json=wanted)
    assert answer.status_code == 422, answer.text
    (problem,) = answer.json()["detail"]
    assert problem["loc"][-1] == place
    assert words in problem["msg"]
    assert (await http.get("/api/comparison")).json()["going"] is None


async def test_a_missing_source_is_reported(http: Any) -> None:
    facts = await _compared(http, source="simulated:nowhere")
    assert "nowhere" in facts["trouble"]
    assert facts["runs"] is None
    assert (await http.get("/api/runs")).json() == []


async def test_an_armed_robot_has_priority(
    serve: Any, peer: Any, drive: Any, eventually: Any
) -> None:
    peer.world = "simulated:lab/1"
    peer.robots = (RobotPort("observer", "socket://127.0.0.1:5001", "amigo-sh", "a robot"),)
    async with serve() as served:
        await eventually(lambda: drive.robots)
        assert (await served.http.post("/api/robots/observer/arm", json={})).is_success
        refused = await served.http.post("/api/comparison", json={})
        assert refused.status_code == 409
        assert "disarm" in refused.json()["detail"]
        assert (await served.http.get("/api/comparison")).json()["going"] is None


async def test_missing_frames_are_not_found(http: Any) -> None:
    for path in ("frames", "frames/0.jpg"):
        assert (await http.get(f"/api/runs/nothing/{path}")).status_code == 404
    run = (await http.post("/api/runs", json={})).json()
    assert (await http.get(f"/api/runs/{run['id']}/frames/0.jpg")).status_code == 409
    await http.post(f"/api/runs/{run['id']}/stop")
    # The peer engine records nothing.
    for path in ("frames", "frames/0.jpg"):
        answer = await http.get(f"/api/runs/{run['id']}/{path}")
        assert answer.status_code == 404
        assert "recording" in answer.json()["detail"]
