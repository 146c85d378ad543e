"""A real server records a run without loss; opening its recording reproduces the run."""

from __future__ import annotations

import asyncio
import csv
import io
import os
import signal
from pathlib import Path
from typing import Any

import pytest

from app.contract.events import live_line
from app.http.server import create_app
from app.reports.page import report_html
from app.reports.report import make_report
from app.settings import Settings
from observer.jsonl import observation_line
from observer.recording.reader import Recording
from observer.recording.replay import replay, replay_revisions
from observer.recording.source import RecordingSource


@pytest.mark.slow
async def test_a_recorded_run_opened_as_a_source_gives_the_same_obstacles(
    tmp_path: Path, serve_app: Any, token: str, eventually: Any
) -> None:
    settings = Settings(data=tmp_path / "data")
    file, file_again = tmp_path / "run.mcap", tmp_path / "again.mcap"
    live: list[dict[str, Any]] = []

    async with asyncio.timeout(100), serve_app(create_app(settings, token), settings) as served:
        server = served.server
        run = (await served.http.post("/api/runs", json={"record": "lossless"})).json()

        def keep(event: Any) -> None:
            if getattr(event, "run_id", None) == run["id"] and hasattr(event, "line"):
                live.append(event.line)

        server.engine.subscribe(keep)
        await eventually(lambda: len(live) >= 12, 40)
        await served.http.patch("/api/parameters", json={"clustering.min_points": 7})
        await eventually(lambda: len(live) >= 24, 40)
        status = (await served.http.get("/api/status")).json()
        assert status["recording"]["images"] == "lossless"
        assert status["recording"]["trouble"] is None
        # Frames not yet in a chunk are lost with the engine; then the same file is continued.
        os.kill(status["engine"]["pid"], signal.SIGKILL)
        await eventually(lambda: server.source.generation == 2, 40)
        await eventually(lambda: sum(line["segment"] == 1 for line in live) >= 10, 40)
        ended = (await served.http.post(f"/api/runs/{run['id']}/stop")).json()
        assert (ended["state"], ended["reason"]) == ("finished", None)
        answer = await served.http.get(f"/api/runs/{run['id']}/recording")
        file.write_bytes(answer.content)
        assert ended["recording_bytes"] == len(answer.content)

        with Recording(file) as recording:
            kept_frames = len(recording.frames)

        async def measured() -> bool:
            """Return whether the length is measured: the lost engine had counted more frames."""
            nonlocal ended
            ended = (await served.http.get(f"/api/runs/{run['id']}")).json()
            return int(ended["frames"]) == kept_frames

        async with asyncio.timeout(20):
            while not await measured():
                await asyncio.sleep(0.05)
        chart = (await served.http.get(f"/api/runs/{run['id']}/chart")).json()
        assert chart["run"]["duration_s"] == ended["duration_s"] > 1.0
        table = (await served.http.get(f"/api/runs/{run['id']}/chart.csv")).text

        again = (await served.http.post(f"/api/runs/{run['id']}/rerun", json={})).json()
        assert again["rerun_of"] == run["id"]
        await eventually(lambda: not server.runs.reruns.facts(), 60)
        ended = (await served.http.get(f"/api/runs/{again['id']}")).json()
        assert (ended["state"], ended["record"]) == ("finished", "none")
        # At full speed, but with the same duration.
        assert ended["duration_s"] == pytest.approx(chart["run"]["duration_s"])
        file_again.write_bytes(
            (await served.http.get(f"/api/runs/{again['id']}/recording")).content
        )
        # The live source is unaffected.
        status = (await served.http.get("/api/status")).json()
        assert status["source"]["spec"] == "simulated:lab"
        assert status["playback"]["rate"] == 1.0

        opened = await served.http.put("/api/source", json={"source": str(file)})
        assert opened.status_code == 200, opened.text
        assert opened.json()["source"]["kind"] == "recording"
        assert opened.json()["has_truth"]
        await eventually(lambda: server.source.latest is not None, 40)
        change = {"paused": True, "seek": 5}
        sought = (await served.http.post("/api/playback", json=change)).json()
        assert (sought["paused"], sought["seekable"]) == (True, True)
        await eventually(lambda: server.source.state.playback.frame == 5, 40)
        beyond = await served.http.post("/api/playback", json={"seek": 100_000})
        assert beyond.status_code == 422

    report = make_report(file, lambda _done, _of: None)
    assert report.duration_s == pytest.approx(chart["run"]["duration_s"])
    assert f"<dd>{report.duration_s:.1f} s, {kept_frames} frames</dd>" in report_html(report)
    truth = [
        float(r["time_s"]) for r in csv.DictReader(io.StringIO(table)) if r["source"] == "truth"
    ]
    assert truth[-1] - truth[0] == pytest.approx(report.duration_s, abs=1e-3)
    with Recording(file) as recording:
        lines = list(recording.lines())
        keys, part = [], -1
        for frame in recording.frames:
            part += frame.begins == "observer"
            keys.append((part, frame.index))
        assert recording.facts.id
        # At most a second of it is lost with an engine.
        assert {line["segment"] for line in lines} == {0, 1}
        by_number = {(line["segment"], line["frame"]): line for line in live}
        known = [line for line in lines if (line["segment"], line["frame"]) in by_number]
        assert len(known) >= 20
        # Pages get the silhouettes drawn into their views instead.
        for line in known:
            shown = live_line(line)
            assert shown == by_number[line["segment"], line["frame"]]
    with Recording(file_again) as recording:
        once_more = list(recording.lines())
        assert len(recording.frames) == len(keys)
    # Comparable while the parameters are those that the run began with.
    first = lines[0]["parameters_revision"]
    same = [line for line in lines if (line["parameters_revision"], line["segment"]) == (first, 0)]
    assert len(same) >= 10
    for line, repeated in zip(same, once_more, strict=False):
        assert repeated["time"] == line["time"]
        assert repeated["pose"] == line["pose"]
        assert repeated["obstacles"] == line["obstacles"]
    source = RecordingSource(file)
    try:
        replayed = list(replay(source, replay_revisions(source.recording)))
    finally:
        source.close()
    found = dict(zip(keys, map(observation_line, replayed), strict=True))
    assert any(line["obstacles"] for line in lines)
    for line in lines:
        again = found[line["segment"], line["frame"]]
        assert again["parameters_revision"] == line["parameters_revision"]
        assert again["pose"] == line["pose"]
        assert again["obstacles"] == line["obstacles"]
