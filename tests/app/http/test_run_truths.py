"""Uploaded ground truth, aligned with a run, and what is then made from it; by real commands."""

from __future__ import annotations

import asyncio
import contextlib
import csv
import io
from pathlib import Path
from typing import Any

import psutil
import pytest

from app.contract.commands import LiveTruthOrder, OpenSource
from app.contract.events import EngineState
from app.server.runs import reruns
from app.workers.rerun.messages import Rerun, Rerunned

from ..planted_runs import DURATION_S, OFFSET_S, plant_run, truth_csv

CAMERA = {
    "x_m": 0.12, "y_m": 0.06, "z_m": 0.25, "pan_deg": 0.0, "tilt_deg": 10.0, "roll_deg": 0.0,
}  # fmt: skip


async def planted(served: Any, **body: Any) -> str:
    """A finished run of the peer engine with a recording that is known exactly."""
    started = await served.http.post("/api/runs", json={"name": "planted", **body})
    id = str(started.json()["id"])
    assert (await served.http.post(f"/api/runs/{id}/stop")).is_success
    await asyncio.to_thread(plant_run, served.server.storage.folder.run(id), id)
    return id


async def upload(served: Any, file: Path, **form: str) -> Any:
    content = {"file": (file.name, file.read_bytes(), "text/csv")}
    return await served.http.post("/api/truth", files=content, data=form)


def work_folders(tmp_path: Path) -> list[str]:
    return [each.name for each in tmp_path.iterdir() if each.name.startswith(".work-")]


async def planted_again(job: Rerun, *_: Any) -> Rerunned:
    """Stands in for the worker: the planted recording has no images to observe."""
    file = await asyncio.to_thread(plant_run, Path(job.output).parent, job.id)
    Path(job.results).touch()
    return Rerunned(390, 1, 0.0, DURATION_S, file.stat().st_size, 0)


async def test_truth_is_aligned_with_a_run_and_shown_in_its_chart(
    http: Any, served: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    id = await planted(served)
    sent = await upload(served, truth_csv(tmp_path / "ride.csv"))
    assert sent.status_code == 201, sent.text
    truth = sent.json()
    assert (truth["name"], truth["format"]) == ("ride.csv", "plain CSV")
    assert [body["name"] for body in truth["info"]["bodies"]] == ["cart"]
    assert [each["id"] for each in (await http.get("/api/truth")).json()] == [truth["id"]]

    before = (await http.get(f"/api/runs/{id}/chart")).json()
    assert (before["aligned"], before["errors"], before["choices"]) == (False, [], None)
    assert {curve["kind"] for curve in before["curves"]} == {"estimate", "commanded"}
    body = {"truth_id": truth["id"], "matches": {"0/1": "cart"}, "camera_on_body": CAMERA}
    answer = await http.post(f"/api/runs/{id}/align", json=body)
    assert answer.status_code == 200, answer.text
    found = answer.json()
    assert (found["aligned"], found["truth_id"]) == (True, truth["id"])
    alignment = found["alignment"]
    assert alignment["offset_s"] == pytest.approx(OFFSET_S, abs=0.01)
    assert abs(alignment["offset_s"] - OFFSET_S) < 3 * alignment["sigma_s"]
    assert {key: each["body"] for key, each in alignment["matches"].items()} == {
        "0:1": "cart", "0:2": "cart",
    }  # fmt: skip
    assert alignment["matches"]["0:1"]["by"] == "person"
    assert "ride.csv" in found["sentence"]

    chart = (await http.get(f"/api/runs/{id}/chart")).json()
    assert chart["run"]["id"] == id
    # The choices are returned, so that they can be sent again with a correction.
    assert chart["choices"] == {
        "observer": None, "ignore": [], "matches": {"0:1": "cart"}, "expected_offset_s": None,
        "camera_on_body": CAMERA,
    }  # fmt: skip
    assert (chart["aligned"], chart["sentence"]) == (True, found["sentence"])
    (change,) = chart["changes"]
    assert (change["body"], change["before"], change["after"]) == ("cart", "0:1", "0:2")
    assert change["time"] == pytest.approx(14.5, abs=0.1)
    (whole,) = (each for each in chart["errors"] if each["group"] == "all")
    assert whole["samples"] > 300
    assert whole["rmse_mps"] < 0.02
    rows = (await http.get(f"/api/runs/{id}/speeds")).json()
    assert {row["source"] for row in rows} == {"truth"}
    assert max(row["speed"] for row in rows) == pytest.approx(0.35, abs=0.02)
    # The second time it is read from its file.
    (kept,) = served.server.storage.folder.run(id).glob(".chart-*.json")
    kept.write_bytes(kept.read_bytes().replace(b'"changes"', b'"changed"'))
    assert "changed" in (await http.get(f"/api/runs/{id}/chart")).json()

    text = (await http.get(f"/api/runs/{id}/chart.csv?begin=3&end=4.5")).text
    table = list(csv.DictReader(io.StringIO(text)))
    assert {row["source"] for row in table} == {"estimate", "truth", "commanded"}
    times = [float(row["time_s"]) for row in table]
    assert min(times) >= 3
    assert max(times) <= 4.5
    assert (await http.get(f"/api/runs/{id}/chart.csv?begin=4&end=4")).status_code == 422

    # A failed alignment keeps the one before.
    body = {"truth_id": truth["id"], "ignore": ["cart"]}
    refused = await http.post(f"/api/runs/{id}/align", json=body)
    assert refused.status_code == 422
    assert refused.json()["detail"][0]["msg"]
    assert (await http.get(f"/api/runs/{id}")).json()["truth_id"] == truth["id"]
    for wrong in (
        {"truth_id": "none"}, {"matches": {"1": "cart"}}, {"observer": ""},
        {"camera_on_body": {"x_m": 1}}, {"camera_on_body": CAMERA | {"tilt_deg": 91}},
    ):  # fmt: skip
        assert (await http.post(f"/api/runs/{id}/align", json=wrong)).status_code == 422

    # A re-run is compared with the same truth.
    monkeypatch.setattr(reruns, "rerun_in_worker", planted_again)
    again = (await http.post(f"/api/runs/{id}/rerun", json={})).json()["id"]
    # The comparison is complete before the re-run counts as done.
    async with asyncio.timeout(60):
        while (await http.get("/api/status")).json()["reruns"]:
            await asyncio.sleep(0.1)
    assert (await http.get(f"/api/runs/{again}")).json()["aligned"]
    assert (await http.get(f"/api/runs/{again}")).json()["truth_id"] == truth["id"]
    choices = (await http.get(f"/api/runs/{again}/chart")).json()["choices"]
    assert (choices["camera_on_body"], choices["matches"]) == (CAMERA, {})

    # The upload is gone, but its file stays while runs need it.
    assert (await http.delete(f"/api/truth/{truth['id']}")).status_code == 204
    assert (await http.delete(f"/api/truth/{truth['id']}")).status_code == 404
    assert served.server.storage.truth_file(truth["id"]).is_file()
    assert work_folders(tmp_path) == []


async def test_live_motion_capture_is_aligned_when_the_run_ends(
    served: Any, eventually: Any
) -> None:
    server = served.server
    server.live_truth.order = LiveTruthOrder("vrpn:127.0.0.1:1", ignore=("nobody",))
    id = (await served.http.post("/api/runs", json={})).json()["id"]
    await asyncio.to_thread(plant_run, server.storage.folder.run(id), id, heard=True)
    assert (await served.http.post(f"/api/runs/{id}/stop")).is_success
    await eventually(lambda: server.storage.get_run(id).aligned, 60)
    found = server.storage.get_run(id)
    assert found.truth_id is None
    assert {row.body for row in server.storage.speeds(id)} == {"cart"}


async def test_ambiguous_angle_conventions_must_be_chosen(served: Any, tmp_path: Path) -> None:
    rows = [
        "Objects", "100", ",,Global Angle A:A,,,,,,",
        "Frame,Sub Frame,RX,RY,RZ,TX,TY,TZ", ",,rad,rad,rad,mm,mm,mm",
    ]  # fmt: skip
    rows += [f"{k},0,{0.5 + k / 300:.4f},{k / 250:.4f},{k / 200:.4f},{k},0,0" for k in range(200)]
    file = tmp_path / "turns.csv"
    file.write_text("\r\n".join(rows) + "\r\n")

    asked = await upload(served, file)
    assert asked.status_code == 422, asked.text
    (problem,) = asked.json()["detail"]
    assert problem["loc"] == ["body", "angles"]
    assert "helical" in problem["msg"]
    assert "Euler" in problem["msg"]
    told = await upload(served, file, angles="helical", rate_hz="50")
    assert told.status_code == 201, told.text
    reading = told.json()["info"]["reading"]
    assert reading == {"rate_hz": 50.0, "angles": "helical"}
    file.write_text("nothing of the kind\n")
    refused = await upload(served, file)
    assert refused.status_code == 422
    assert refused.json()["detail"][0]["msg"].startswith("turns.csv")
    assert (await served.http.post("/api/truth", json={})).status_code in (415, 422)
    assert work_folders(tmp_path) == []


async def test_exports_are_generated_and_missing_parts_are_named(
    http: Any, served: Any, tmp_path: Path
) -> None:
    id = await planted(served)
    table = await http.get(f"/api/runs/{id}/export", params={"format": "csv"})
    assert table.status_code == 200, table.text
    assert "obstacles.csv" in table.headers["content-disposition"]
    assert len(table.text.splitlines()) > 300
    # It was recorded without images.
    asked = await http.head(f"/api/runs/{id}/export", params={"format": "csv"})
    assert (asked.status_code, asked.content) == (200, b"")
    assert asked.headers["content-length"] == str(len(table.content))
    video = await http.get(f"/api/runs/{id}/export", params={"format": "mp4"})
    assert video.status_code == 409
    assert "images" in video.json()["detail"]
    wrong = await http.get(f"/api/runs/{id}/export", params={"format": "zip", "table": "truth"})
    assert wrong.status_code == 422
    for path in ("chart", "chart.png", "report", "export"):
        assert (await http.get(f"/api/runs/none/{path}")).status_code == 404
    assert work_folders(tmp_path) == []


async def test_a_command_ends_when_its_client_disconnects(
    served: Any, tmp_path: Path, eventually: Any
) -> None:
    def children() -> list[psutil.Process]:
        found = []
        for child in psutil.Process().children():
            with contextlib.suppress(psutil.NoSuchProcess):
                found += [child] if "app.runtime.worker_main" in child.cmdline() else []
        return found

    id = await planted(served)
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(0.4):
            await served.http.get(f"/api/runs/{id}/report")
    await eventually(lambda: not children())
    await eventually(lambda: work_folders(tmp_path) == [])
    # Other requests are not held up by it.
    assert (await served.http.get(f"/api/runs/{id}/chart")).is_success


async def test_a_run_is_reprocessed_with_other_parameters(
    http: Any, served: Any, peer: Any
) -> None:
    values = {"ego_motion.ransac_threshold_px": 2.0, "guard.stop_margin_m": 0.5}
    known = (await http.get("/api/parameters")).json()["values"]
    values = {key: value for key, value in values.items() if key in known}
    id = await planted(served, parameters=values)
    await http.patch("/api/parameters", json={"ego_motion.ransac_threshold_px": 5.0})
    body = {"name": "again", "parameters": {"clustering.min_points": 9}}
    opened = [each for each in peer.commands if isinstance(each, OpenSource)]
    started = await http.post(f"/api/runs/{id}/rerun", json=body)
    assert started.status_code == 201, started.text
    again = started.json()
    assert (again["rerun_of"], again["name"], again["record"]) == (id, "again", "none")
    assert again["parameters"]["ego_motion.ransac_threshold_px"] == 2.0
    assert again["parameters"]["clustering.min_points"] == 9
    (note,) = again["parameter_notes"]
    assert note.startswith("clustering.min_points has no effect")
    # The live source stays as it is.
    assert [each for each in peer.commands if isinstance(each, OpenSource)] == opened
    values = (await http.get("/api/parameters")).json()["values"]
    assert values["ego_motion.ransac_threshold_px"] == 5.0
    (going,) = (await http.get("/api/status")).json()["reruns"]
    assert (going["id"], going["rerun_of"], going["name"]) == (again["id"], id, "again")
    # The planted recording has no images, which only its reader notices.
    ended = await rerun_ended(http, again["id"])
    assert ended["state"] == "failed"
    assert "without images" in ended["reason"]
    # A re-run of a re-run uses the first run's images.
    third = (await http.post(f"/api/runs/{again['id']}/rerun", json={})).json()
    assert (third["rerun_of"], third["source"]) == (again["id"], "simulated:lab")
    assert (await http.delete(f"/api/runs/{third['id']}")).status_code == 204
    assert (await http.get(f"/api/runs/{third['id']}")).status_code == 404
    bare = (await http.post("/api/runs", json={"record": "none"})).json()["id"]
    await http.post(f"/api/runs/{bare}/stop")
    refused = await http.post(f"/api/runs/{bare}/rerun", json={})
    assert refused.status_code == 404
    assert "images" in refused.json()["detail"]
    assert served.server.source.state.state is EngineState.PREVIEW


async def rerun_ended(http: Any, id: str) -> Any:
    """Wait for the end of a re-run and return it."""
    async with asyncio.timeout(60):
        while (run := (await http.get(f"/api/runs/{id}")).json())["state"] == "running":
            await asyncio.sleep(0.05)
    return run
