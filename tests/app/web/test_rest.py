"""The REST interface over a peer engine: values, refusals, and nothing half-done."""

from __future__ import annotations

import asyncio
import json
import sqlite3
import sys
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.messages import (
    DenseStereoEvent,
    ExplainPixel,
    OpenSource,
    SetParameters,
    SetPlayback,
    StopRun,
)

JSON = {"Content-Type": "application/json"}
THRESHOLD = "ego_motion.ransac_threshold_px"


def run(serve: Any, scenario: Any, **settings: Any) -> None:
    async def serving() -> None:
        async with serve(**settings) as served:
            await scenario(served)

    asyncio.run(serving())


# --- values that are none ------------------------------------------------------------------


NO_NUMBERS = [
    *("NaN", "Infinity", "-Infinity", "1e999", "-1e999", "true", "1e5", "-1", '"2"'),
    *("null", "[]", "{}"),
]


def test_what_is_no_number_in_range_is_refused_and_changes_nothing(serve: Any, peer: Any) -> None:
    async def scenario(served: Any) -> None:
        before = (await served.http.get("/api/parameters")).json()
        for value in NO_NUMBERS:
            body = f'{{"{THRESHOLD}": {value}, "flow.window_px": 21}}'
            answer = await served.http.patch("/api/parameters", content=body, headers=JSON)
            assert answer.status_code == 422, value
            problems = answer.json()["detail"]
            assert all(set(problem) == {"loc", "msg", "type"} for problem in problems)
            assert any(THRESHOLD in problem["loc"] for problem in problems), value
            assert (await served.http.get("/api/parameters")).json() == before
        assert not any(isinstance(command, SetParameters) for command in peer.commands)

    run(serve, scenario)


def test_a_refused_parameter_is_told_with_its_range(serve: Any) -> None:
    async def scenario(served: Any) -> None:
        answer = await served.http.patch("/api/parameters", json={THRESHOLD: 25.0, "flow.x": 1})
        detail = {problem["loc"][-1]: problem for problem in answer.json()["detail"]}
        assert detail[THRESHOLD] == {
            "loc": ["body", THRESHOLD],
            "msg": "must be a finite number from 0.1 to 20 px",
            "type": "parameter",
        }
        assert "no such parameter" in detail["flow.x"]["msg"]

    run(serve, scenario)


def test_a_missing_extra_is_told_and_the_old_parameters_stay(
    serve: Any, peer: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "mahotas", None)

    async def scenario(served: Any) -> None:
        before = (await served.http.get("/api/parameters")).json()
        change = {"features.detector": "surf", THRESHOLD: 2.5}
        answer = await served.http.patch("/api/parameters", json=change)
        assert answer.status_code == 422
        (problem,) = answer.json()["detail"]
        assert problem["loc"] == ["body", "features.detector"]
        assert "pip install 'dynamic-observer[surf]'" in problem["msg"]
        assert (await served.http.get("/api/parameters")).json() == before
        started = await served.http.post("/api/runs", json={"parameters": change})
        assert started.status_code == 422
        assert not any(isinstance(command, SetParameters) for command in peer.commands)

    run(serve, scenario)


BAD_VALUES = [
    ("/api/playback", "POST", '{"rate": NaN}'),
    ("/api/playback", "POST", '{"rate": 1e999}'),
    ("/api/playback", "POST", '{"rate": true}'),
    ("/api/playback", "POST", '{"rate": 9}'),
    ("/api/playback", "POST", '{"rate": "1"}'),
    ("/api/playback", "POST", '{"step": -1}'),
    ("/api/playback", "POST", '{"step": 1.5}'),
    ("/api/playback", "POST", '{"paused": 1}'),
    ("/api/playback", "POST", '{"unknown": 1}'),
    ("/api/runs", "POST", '{"parameters": {"flow.window_px": NaN}}'),
    ("/api/runs", "POST", '{"parameters": {"flow.window_px": 10000}}'),
    ("/api/runs", "POST", '{"preset": "none of this name"}'),
    ("/api/runs", "POST", '{"name": ""}'),
    ("/api/runs", "POST", '{"name": "two\\nlines"}'),
    ("/api/runs", "POST", '{"name": "\\ud800"}'),
    ("/api/runs", "POST", '{"\\ud800": 1}'),
    ("/api/runs", "POST", '{"source": "missing"}'),
    ("/api/runs", "POST", '{"calibration": "none"}'),
    ("/api/source", "PUT", '{"source": "missing"}'),
    ("/api/source", "PUT", '{"source": "a\\u0000b"}'),
    ("/api/source", "PUT", '{"source": "simulated:lab", "calibration": "none"}'),
    ("/api/source", "PUT", "{}"),
    ("/api/source", "PUT", "[]"),
    ("/api/source", "PUT", "null"),
    ("/api/source", "PUT", ""),
    ("/api/presets", "POST", '{"name": "\\u0000"}'),
    ("/api/presets", "POST", '{"name": 1}'),
    ("/api/presets", "POST", '{"name": Infinity}'),
    ("/api/calibrations", "POST", "{}"),
]


def test_bad_values_are_answered_with_422(serve: Any, peer: Any) -> None:
    async def scenario(served: Any) -> None:
        opened = peer.opened
        for path, method, body in BAD_VALUES:
            answer = await served.http.request(method, path, content=body, headers=JSON)
            assert answer.status_code == 422, (path, body, answer.text)
            assert answer.json()["detail"][0]["loc"][0] == "body", body
            assert peer.opened == opened
            assert (await served.http.get("/api/runs")).json() == []
        assert (await served.http.get("/api/parameters")).json()["revision"] == 0

    run(serve, scenario)


MALFORMED = {
    "cut": b"{",
    "no text": b"\xff\xfe\x00",
    "deep object": b'{"a": ' * 20_000,
    "deep list": b"[" * 100_000,
    "long number": b"9" * 100_000,
    "huge rate": b'{"rate": 1' + b"0" * 5000 + b"}",
    "long key": b'{"' + b"a" * 50_000 + b'": 1}',
}


def test_malformed_and_deep_json_is_the_clients_fault(serve: Any) -> None:
    async def scenario(served: Any) -> None:
        for name, body in MALFORMED.items():
            for method, path in (("PATCH", "/api/parameters"), ("POST", "/api/playback")):
                answer = await served.http.request(method, path, content=body, headers=JSON)
                assert 400 <= answer.status_code < 500, (name, answer.text)
                assert len(answer.content) < 5000
        assert (await served.http.get("/api/status")).is_success

    run(serve, scenario)


ANY_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.deferred(lambda: st.sampled_from(KNOWN_KEYS)) | st.text(max_size=10),
            inner,
            max_size=4,
        )
    ),
    max_leaves=8,
)
TAKE_JSON = [
    ("PATCH", "/api/parameters"),
    ("POST", "/api/playback"),
    ("POST", "/api/presets"),
    ("POST", "/api/runs"),
    ("PUT", "/api/source"),
    ("POST", "/api/calibrating"),
    ("PATCH", "/api/calibrating"),
    ("POST", "/api/calibrating/compute"),
    ("POST", "/api/calibrating/save"),
    ("PATCH", "/api/calibrations/none"),
    ("POST", "/api/calibrations/none/tape-checks"),
    ("PUT", "/api/rig"),
    ("PUT", "/api/rig/file"),
]
KNOWN_KEYS = [
    *("name", "source", "rate", "step", "preset", "parameters", THRESHOLD),
    *("square_mm", "columns", "capture", "remove", "automatic", "activate", "u", "v"),
    *("measured_m", "mount", "height_m", "value", "sigma", "models", "text"),
]


def test_no_json_breaks_the_server(serve: Any) -> None:
    with asyncio.Runner() as runner:
        serving = serve()
        served = runner.run(serving.__aenter__())
        try:

            @settings(deadline=None, max_examples=100)
            @given(st.sampled_from(TAKE_JSON), ANY_JSON)
            def check(route: tuple[str, str], value: Any) -> None:
                body = json.dumps(value)
                sent = served.http.request(*route, content=body, headers=JSON)
                answer = runner.run(sent)
                assert answer.status_code < 500, (route, body, answer.text)

            check()
        finally:
            runner.run(serving.__aexit__(None, None, None))


def test_a_locked_database_is_answered_with_503(serve: Any, peer: Any, tmp_path: Path) -> None:
    async def scenario(served: Any) -> None:
        lock = sqlite3.connect(tmp_path / "observer.sqlite", isolation_level=None)
        lock.execute("BEGIN IMMEDIATE")
        try:
            for path, body in (("/api/runs", {}), ("/api/presets", {"name": "x"})):
                answer = await served.http.post(path, json=body)
                assert answer.status_code == 503, answer.text
                assert "locked" in answer.json()["detail"]
                assert answer.headers["retry-after"]
            assert peer.opened.run_id is None
            # Reading, observing and changing go on.
            assert (await served.http.get("/api/runs")).json() == []
            assert (await served.http.patch("/api/parameters", json={THRESHOLD: 5})).is_success
        finally:
            lock.execute("ROLLBACK")
            lock.close()
        assert (await served.http.post("/api/runs", json={})).status_code == 201

    run(serve, scenario)


# --- parameters and presets ----------------------------------------------------------------


def test_parameters_reach_the_engine_and_outlive_the_server(
    serve: Any, peer: Any, storage: Any
) -> None:
    async def scenario(served: Any) -> None:
        answer = await served.http.patch(
            "/api/parameters", json={THRESHOLD: 3.5, "stereo.matcher": "bm"}
        )
        state = answer.json()
        assert state["revision"] == 1
        assert state["values"][THRESHOLD] == 3.5
        assert state["frame"] == 1
        assert state["preset"] is None
        assert peer.parameters[THRESHOLD] == 3.5
        assert peer.commands[-1].revision == 1
        # What changes nothing is no new revision.
        again = await served.http.patch("/api/parameters", json={THRESHOLD: 3.5})
        assert again.json()["revision"] == 1
        assert (await served.http.get("/api/status")).json()["parameters_revision"] == 1

    run(serve, scenario)
    with storage:
        assert storage.load_parameters().revision == 1
        assert storage.load_parameters().values["stereo.matcher"] == "bm"
        (change,) = storage.parameter_revisions(None)
        assert change.difference == {THRESHOLD: 3.5, "stereo.matcher": "bm"}


def test_parameters_change_without_an_engine_and_reach_the_next(serve: Any, peer: Any) -> None:
    async def scenario(served: Any) -> None:
        peer.lose()
        state = (await served.http.patch("/api/parameters", json={THRESHOLD: 4.0})).json()
        assert state["values"][THRESHOLD] == 4.0
        assert state["frame"] is None
        peer.start_process()
        while peer.opened is None:
            await asyncio.sleep(0.01)
        assert peer.opened.parameters[THRESHOLD] == 4.0
        assert peer.opened.parameters_revision == 1

    run(serve, scenario)


def test_presets_are_saved_used_and_deleted(serve: Any) -> None:
    async def scenario(served: Any) -> None:
        names = [p["name"] for p in (await served.http.get("/api/presets")).json()]
        assert names == ["paper", "default"]
        await served.http.patch("/api/parameters", json={THRESHOLD: 2.5})
        saved = await served.http.post("/api/presets", json={"name": "My own ü"})
        assert saved.status_code == 201
        assert saved.json()["built_in"] is False
        assert saved.json()["values"][THRESHOLD] == 2.5
        now = (await served.http.get("/api/parameters")).json()
        assert now["preset"] == "My own ü"
        paper = next(
            p for p in (await served.http.get("/api/presets")).json() if p["name"] == "paper"
        )
        used = await served.http.patch("/api/parameters", json=paper["values"])
        assert used.json()["preset"] == "paper"
        taken = await served.http.post("/api/presets", json={"name": "My own ü"})
        assert taken.status_code == 409
        assert (await served.http.post("/api/presets", json={"name": "paper"})).status_code == 409
        assert (await served.http.delete("/api/presets/My own ü")).status_code == 204
        assert (await served.http.delete("/api/presets/My own ü")).status_code == 404
        assert (await served.http.delete("/api/presets/paper")).status_code == 409

    run(serve, scenario)


def test_the_schema_describes_every_parameter(serve: Any) -> None:
    async def scenario(served: Any) -> None:
        schema = (await served.http.get("/api/parameters/schema")).json()
        values = (await served.http.get("/api/parameters")).json()["values"]
        assert [entry["name"] for entry in schema] == list(values)
        threshold = next(entry for entry in schema if entry["name"] == THRESHOLD)
        assert (threshold["minimum"], threshold["maximum"], threshold["unit"]) == (0.1, 20.0, "px")
        assert "choices" not in threshold

    run(serve, scenario)


# --- source and playback -------------------------------------------------------------------


def test_choosing_a_source(serve: Any, peer: Any) -> None:
    async def scenario(served: Any) -> None:
        assert peer.opened.source == "simulated:lab"
        sources = (await served.http.get("/api/sources")).json()
        assert sources[0]["spec"] == "simulated:lab"
        assert all(set(entry) == {"spec", "title", "help"} for entry in sources)
        answer = await served.http.put("/api/source", json={"source": "some/folder"})
        assert answer.json()["source"]["spec"] == "some/folder"
        assert peer.opened.loop is True
        refused = await served.http.put("/api/source", json={"source": "missing"})
        assert refused.status_code == 422
        assert refused.json()["detail"][0]["loc"] == ["body", "source"]
        assert (await served.http.get("/api/status")).json()["source"]["spec"] == "some/folder"

    run(serve, scenario)


def test_playback(serve: Any, peer: Any) -> None:
    async def scenario(served: Any) -> None:
        answer = await served.http.post("/api/playback", json={"paused": True, "step": 2})
        assert answer.json()["paused"] is True
        assert peer.commands[-1] == SetPlayback(paused=True, step=2)
        peer.lose()
        assert (await served.http.post("/api/playback", json={})).status_code == 503

    run(serve, scenario)


# --- runs ----------------------------------------------------------------------------------


def test_a_run_from_start_to_csv(serve: Any, peer: Any) -> None:
    async def scenario(served: Any) -> None:
        body = {"name": "First", "preset": "paper", "parameters": {THRESHOLD: 2.0}}
        started = await served.http.post("/api/runs", json=body)
        assert started.status_code == 201, started.text
        id = started.json()["id"]
        assert started.json()["state"] == "running"
        assert started.json()["parameters"]["matching.method"] == "descriptor"
        assert peer.opened.run_id == id
        assert peer.opened.parameters[THRESHOLD] == 2.0
        assert (await served.http.get("/api/parameters")).json()["values"][THRESHOLD] == 2.0
        for _ in range(20):
            peer.observe()
        status = (await served.http.get("/api/status")).json()
        assert status["run"]["id"] == id
        assert (await served.http.post("/api/runs", json={})).status_code == 409
        other = await served.http.put("/api/source", json={"source": "x"})
        assert other.status_code == 409
        assert (await served.http.delete(f"/api/runs/{id}")).status_code == 409
        assert (await served.http.get(f"/api/runs/{id}")).json()["frames"] == 20

        stopped = await served.http.post(f"/api/runs/{id}/stop")
        assert stopped.json()["state"] == "finished"
        assert stopped.json()["frames"] == 20
        assert stopped.json()["ended_at"]
        assert (await served.http.post(f"/api/runs/{id}/stop")).status_code == 409
        assert (await served.http.get("/api/status")).json()["run"] is None

        rows = (await served.http.get(f"/api/runs/{id}/speeds")).json()
        assert {row["source"] for row in rows} == {"estimate", "truth", "commanded"}
        assert len(rows) == 60
        answer = await served.http.get(f"/api/runs/{id}/speeds", params={"format": "csv"})
        assert answer.headers["content-type"].startswith("text/csv")
        lines = answer.text.splitlines()
        assert lines[0] == "time,role,source,track_id,speed,std,segment"
        assert lines[1] == "0.0,obstacle,estimate,7,0.4,0.05,0"
        assert lines[2] == "0.0,obstacle,truth,1,0.4,,0"
        assert len(lines) == 61
        assert (await served.http.get(f"/api/runs/{id}/speeds?format=xml")).status_code == 422

        assert [r["id"] for r in (await served.http.get("/api/runs")).json()] == [id]
        assert (await served.http.delete(f"/api/runs/{id}")).status_code == 204
        assert (await served.http.get(f"/api/runs/{id}")).status_code == 404
        assert (await served.http.get(f"/api/runs/{id}/speeds")).status_code == 404
        assert (await served.http.delete(f"/api/runs/{id}")).status_code == 404

    run(serve, scenario)


def test_a_run_whose_source_is_refused_was_never_there(serve: Any, peer: Any) -> None:
    async def scenario(served: Any) -> None:
        answer = await served.http.post("/api/runs", json={"source": "missing"})
        assert answer.status_code == 422
        assert (await served.http.get("/api/runs")).json() == []
        status = (await served.http.get("/api/status")).json()
        assert status["run"] is None
        assert status["source"]["spec"] == "simulated:lab"
        assert not any(isinstance(command, StopRun) for command in peer.commands)

    run(serve, scenario)


# --- calibrations --------------------------------------------------------------------------


def upload(text: str | bytes, name: str = "cal.yaml") -> dict[str, Any]:
    return {"files": {"file": (name, text, "application/yaml")}}


def test_a_calibration_from_upload_to_use(serve: Any, peer: Any, calibration_yaml: Any) -> None:
    async def scenario(served: Any) -> None:
        http = served.http
        text = calibration_yaml()
        answer = await http.post("/api/calibrations", **upload(text, "../../my cal.yaml"))
        assert answer.status_code == 201, answer.text
        entry = answer.json()
        assert entry["name"] == "my cal.yaml"
        assert (entry["width"], entry["height"], entry["baseline_m"]) == (512, 256, 0.12)
        assert entry["rectified"] is True
        assert abs(entry["hfov_deg"] - 60.05) < 0.1
        assert entry["active"] is False
        id = entry["id"]
        again = await http.post("/api/calibrations", **upload(text))
        assert again.json()["id"] == id
        assert (await http.get(f"/api/calibrations/{id}/file")).text == text

        preview = await http.get(f"/api/calibrations/{id}/preview")
        assert preview.headers["x-vertical-error-px"] == "0.125"
        assert preview.headers["content-type"] == "image/jpeg"
        assert peer.opened.calibration_yaml is None

        used = await http.post(f"/api/calibrations/{id}/activate")
        assert used.json()["calibration"]["id"] == id
        assert peer.opened.calibration_yaml == text
        assert (await http.get("/api/calibrations")).json()[0]["active"] is True
        assert (await http.delete(f"/api/calibrations/{id}")).status_code == 409

        started = (await http.post("/api/runs", json={})).json()
        assert started["calibration_id"] == id
        assert (await http.post("/api/calibrations/deactivate")).status_code == 409
        assert (await http.post(f"/api/calibrations/{id}/activate")).status_code == 409
        await http.post(f"/api/runs/{started['id']}/stop")

        back = await http.post("/api/calibrations/deactivate")
        assert back.json()["calibration"] is None
        assert peer.opened.calibration_yaml is None
        assert (await http.delete(f"/api/calibrations/{id}")).status_code == 204
        assert (await http.get("/api/calibrations")).json() == []
        # The run still refers to it, so it can be fetched, but not used any more.
        assert (await http.get(f"/api/calibrations/{id}/file")).text == text
        assert (await http.get(f"/api/calibrations/{id}/preview")).status_code == 404
        assert (await http.get(f"/api/calibrations/{'0' * 64}/file")).status_code == 404

    run(serve, scenario)


BAD_CALIBRATIONS = {
    "empty": b"",
    "jpeg": b"\xff\xd8\xff\xe0",
    "words": b"hello",
    "incomplete": b"image_width: 512\nimage_height: 256\n",
    "alias bomb": b"a: &a [x,x]\nb: &b [*a,*a,*a]\nc: &c [*b,*b,*b]\nd: [*c,*c,*c]\n",
    "python object": b"!!python/object/apply:os.system ['true']",
    "xml entity": b"<!DOCTYPE x [<!ENTITY a 'b'>]><opencv_storage>&a;</opencv_storage>",
}


def test_a_run_keeps_the_calibration_that_came_with_its_source(
    serve: Any, calibration_yaml: Any
) -> None:
    async def scenario(served: Any) -> None:
        http = served.http
        started = (await http.post("/api/runs", json={})).json()
        await http.post(f"/api/runs/{started['id']}/stop")
        kept = (await http.get(f"/api/runs/{started['id']}")).json()["calibration_id"]
        assert kept is not None
        assert kept == started["calibration_id"]
        file = await http.get(f"/api/calibrations/{kept}/file")
        assert file.text == calibration_yaml()
        assert (await http.get("/api/calibrations")).json() == []
        assert (await http.post(f"/api/calibrations/{kept}/activate")).status_code == 404

    run(serve, scenario)


def test_metrics_are_the_statuss_figures_as_prometheus_reads_them(serve: Any, peer: Any) -> None:
    async def scenario(served: Any) -> None:
        peer.observe()
        peer.publish(DenseStereoEvent(0, 0.0, 0.1, 0.05, 1, None))
        answer = await served.http.get("/metrics")
        assert answer.headers["content-type"].startswith("text/plain")
        lines = answer.text.splitlines()
        assert "dynamic_observer_frames_observed_total 1.0" in lines
        assert 'dynamic_observer_engine_state{state="preview"} 1.0' in lines
        assert 'dynamic_observer_engine_state{state="failed"} 0.0' in lines
        assert "dynamic_observer_dense_stereo_per_second 0.0" in lines
        assert any(line.startswith("dynamic_observer_dense_stereo_age_seconds ") for line in lines)
        assert any(line.startswith('dynamic_observer_stage_ms{stage="') for line in lines)

    run(serve, scenario)


def test_bad_calibrations_are_refused_in_one_sentence(serve: Any) -> None:
    async def scenario(served: Any) -> None:
        for name, content in BAD_CALIBRATIONS.items():
            answer = await served.http.post("/api/calibrations", **upload(content))
            assert answer.status_code == 422, (name, answer.text)
            (problem,) = answer.json()["detail"]
            assert problem["loc"] == ["body", "file"]
            assert 10 < len(problem["msg"]) < 400, name
        assert (await served.http.get("/api/calibrations")).json() == []

    run(serve, scenario)


def test_a_source_without_calibration_gets_one(
    serve: Any, peer: Any, calibration_yaml: Any
) -> None:
    async def scenario(served: Any) -> None:
        assert (await served.http.get("/api/status")).json()["engine"]["state"] == "failed"
        entry = (await served.http.post("/api/calibrations", **upload(calibration_yaml()))).json()
        body = {"source": "uncalibrated", "calibration": entry["id"]}
        answer = await served.http.put("/api/source", json=body)
        assert answer.json()["engine"]["state"] == "preview"
        assert peer.opened.source == "uncalibrated"

    run(serve, scenario, source="uncalibrated")


def test_a_calibration_can_be_activated_where_the_source_failed_for_want_of_one(
    serve: Any, peer: Any, calibration_yaml: Any
) -> None:
    async def scenario(served: Any) -> None:
        entry = (await served.http.post("/api/calibrations", **upload(calibration_yaml()))).json()
        answer = await served.http.post(f"/api/calibrations/{entry['id']}/activate")
        assert answer.json()["engine"]["state"] == "preview"
        assert isinstance(peer.opened, OpenSource)

    run(serve, scenario, source="uncalibrated")


# --- pixels --------------------------------------------------------------------------------


def test_a_pixel_answers_with_its_figures(serve: Any, peer: Any) -> None:
    async def scenario(served: Any) -> None:
        early = await served.http.get("/api/pixel?u=1&v=1")
        assert early.status_code == 409
        assert early.json()["detail"] == "no frame has been observed yet"
        peer.observe()
        answer = await served.http.get("/api/pixel?u=100.5&v=20")
        assert answer.status_code == 200, answer.text
        body = answer.json()
        assert peer.commands[-1] == ExplainPixel(100.5, 20.0)
        assert (body["u"], body["v"], body["frame"]) == (100.5, 20.0, 0)
        assert body["numbers"] == {"residual_px": 4.2, "depth_m": None}
        assert body["obstacle"]["id"] == 7
        peer.lose()
        assert (await served.http.get("/api/pixel?u=1&v=1")).status_code == 503

    run(serve, scenario)


def test_what_is_no_pixel_is_refused_in_one_sentence(serve: Any, peer: Any) -> None:
    async def scenario(served: Any) -> None:
        peer.observe()
        asked = len(peer.commands)
        for query in ("u=1", "v=1", "u=nan&v=1", "u=1&v=inf", "u=a&v=1", "u=1e9&v=1", ""):
            answer = await served.http.get(f"/api/pixel?{query}")
            assert answer.status_code == 422, query
            assert answer.json()["detail"][0]["loc"][0] == "query"
        assert len(peer.commands) == asked
        outside = await served.http.get("/api/pixel?u=512&v=1")
        assert outside.status_code == 422
        (problem,) = outside.json()["detail"]
        assert "512 x 256" in problem["msg"]

    run(serve, scenario)


def test_the_status_tells_how_the_camera_moved(serve: Any, peer: Any) -> None:
    motion = {
        "model": "affine",
        "status": "ok",
        "matches": 50,
        "inliers": 45,
        "dt": 0.133,
        "decomposition": {
            "translation_px": [5.0, 0.1],
            "rotation_rad": 0.01,
            "shear": None,
            "scale": [1.0, 1.01],
        },
        "motion": {"rotation_rad": [0.0, 0.01, 0.0], "translation_m": [0.02, 0.0, 0.0]},
    }

    async def scenario(served: Any) -> None:
        assert (await served.http.get("/api/status")).json()["ego_motion"] is None
        peer.observe(ego_motion=motion)
        assert (await served.http.get("/api/status")).json()["ego_motion"] == motion

    run(serve, scenario)


# --- the description -----------------------------------------------------------------------


def test_the_description_is_whole_and_stays_on_this_machine(serve: Any) -> None:
    async def scenario(served: Any) -> None:
        schema = (await served.http.get("/openapi.json")).json()
        assert schema["openapi"].startswith("3.")
        for path, methods in schema["paths"].items():
            for method, operation in methods.items():
                where = (path, method)
                assert operation["summary"], where
                assert operation["tags"], where
                assert {"401", "403"} <= set(operation["responses"]), where
        references = set(find(schema, "$ref"))
        assert all(reference.startswith("#/components/schemas/") for reference in references)
        known = set(schema["components"]["schemas"])
        assert {reference.rpartition("/")[2] for reference in references} <= known
        page = await served.http.get("/docs")
        assert "http://" not in page.text
        assert "https://" not in page.text
        script = await served.http.get("/docs/start.js")
        assert script.headers["content-type"].startswith("text/javascript")

    run(serve, scenario)


def find(value: Any, key: str) -> list[str]:
    if isinstance(value, dict):
        return [v for k, v in value.items() if k == key] + [
            found for v in value.values() for found in find(v, key)
        ]
    if isinstance(value, list):
        return [found for v in value for found in find(v, key)]
    return []


def test_status_is_what_is_promised(serve: Any, peer: Any) -> None:
    async def scenario(served: Any) -> None:
        for _ in range(5):
            peer.observe()
        status = (await served.http.get("/api/status")).json()
        assert status["engine"]["state"] == "preview"
        assert status["engine"]["generation"] == 1
        assert status["frames_observed"] == 5
        assert status["timings_ms"]["features"] == 2.0
        assert status["has_truth"] is True
        assert status["latency_ms"] == {"median": None, "p95": None, "count": 0}
        assert json.dumps(status, allow_nan=False)
        assert (await served.http.get("/readyz")).is_success
        peer.lose("the engine gave no sign of life for 1.5 s")
        status = (await served.http.get("/api/status")).json()
        assert status["engine"]["state"] == "failed"
        assert "no sign of life" in status["engine"]["reason"]
        assert (await served.http.get("/readyz")).status_code == 503
        assert (await served.http.get("/healthz")).is_success

    run(serve, scenario)
