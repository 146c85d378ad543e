"""The status, requests about a pixel, the metrics, and the API's description."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

from app.contract.commands import ExplainPixel
from app.contract.events import DenseStereoEvent
from app.contract.status import CameraMotion, Decomposition, EgoMotionStatus
from observer.exporting.tables import TABLES


async def test_metrics_give_the_status_figures_in_prometheus_format(http: Any, peer: Any) -> None:
    peer.observe()
    peer.publish(DenseStereoEvent(0, 0.0, 0.1, 0.05, 1, None))
    answer = await http.get("/metrics")
    assert answer.headers["content-type"].startswith("text/plain")
    lines = answer.text.splitlines()
    assert "dynamic_observer_frames_observed_total 1.0" in lines
    assert 'dynamic_observer_engine_state{state="preview"} 1.0' in lines
    assert 'dynamic_observer_engine_state{state="failed"} 0.0' in lines
    assert "dynamic_observer_dense_stereo_per_second 0.0" in lines
    assert any(line.startswith("dynamic_observer_dense_stereo_age_seconds ") for line in lines)
    assert any(line.startswith('dynamic_observer_stage_ms{stage="') for line in lines)


# --- pixels --------------------------------------------------------------------------------


async def test_a_pixel_is_explained_with_its_figures(http: Any, peer: Any) -> None:
    early = await http.get("/api/pixel?u=1&v=1")
    assert early.status_code == 409
    assert early.json()["detail"] == "no frame has been observed yet"
    peer.observe()
    answer = await http.get("/api/pixel?u=100.5&v=20")
    assert answer.status_code == 200, answer.text
    body = answer.json()
    assert peer.commands[-1] == ExplainPixel(100.5, 20.0)
    assert (body["u"], body["v"], body["frame"]) == (100.5, 20.0, 0)
    assert body["numbers"] == {"residual_px": 4.2, "depth_m": None}
    assert body["obstacle"]["id"] == 7
    peer.lose()
    assert (await http.get("/api/pixel?u=1&v=1")).status_code == 503


async def test_an_invalid_pixel_is_refused_with_a_reason(http: Any, peer: Any) -> None:
    peer.observe()
    asked = len(peer.commands)
    for query in ("u=1", "v=1", "u=nan&v=1", "u=1&v=inf", "u=a&v=1", "u=1e9&v=1", ""):
        answer = await http.get(f"/api/pixel?{query}")
        assert answer.status_code == 422, query
        assert answer.json()["detail"][0]["loc"][0] == "query"
    assert len(peer.commands) == asked
    outside = await http.get("/api/pixel?u=512&v=1")
    assert outside.status_code == 422
    (problem,) = outside.json()["detail"]
    assert "512 x 256" in problem["msg"]


async def test_the_status_reports_the_camera_motion(http: Any, peer: Any) -> None:
    motion = EgoMotionStatus(
        model="affine",
        status="ok",
        matches=50,
        inliers=45,
        dt=0.133,
        decomposition=Decomposition([5.0, 0.1], 0.01, None, [1.0, 1.01]),
        motion=CameraMotion([0.0, 0.01, 0.0], [0.02, 0.0, 0.0]),
    )
    assert (await http.get("/api/status")).json()["ego_motion"] is None
    peer.observe(ego_motion=motion)
    assert (await http.get("/api/status")).json()["ego_motion"] == asdict(motion)


# --- the description -----------------------------------------------------------------------


async def test_the_api_description_is_complete_and_self_hosted(served: Any) -> None:
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


async def test_every_exportable_table_can_be_requested(served: Any) -> None:
    schema = (await served.http.get("/openapi.json")).json()
    asked = schema["paths"]["/api/runs/{id}/export"]["get"]["parameters"]
    (table,) = (each["schema"] for each in asked if each["name"] == "table")
    assert set(table["anyOf"][0]["enum"]) == set(TABLES)


def find(value: Any, key: str) -> list[str]:
    if isinstance(value, dict):
        return [v for k, v in value.items() if k == key] + [
            found for v in value.values() for found in find(v, key)
        ]
    if isinstance(value, list):
        return [found for v in value for found in find(v, key)]
    return []


async def test_status_reports_the_promised_values(http: Any, peer: Any) -> None:
    for _ in range(5):
        peer.observe()
    status = (await http.get("/api/status")).json()
    assert status["engine"]["state"] == "preview"
    assert status["engine"]["generation"] == 1
    assert status["frames_observed"] == 5
    assert status["timings_ms"]["features"] == 2.0
    assert status["has_truth"] is True
    assert status["latency_ms"] == {"median": None, "p95": None, "count": 0}
    assert json.dumps(status, allow_nan=False)
    assert (await http.get("/readyz")).is_success
    peer.lose("the engine did not respond for 1.5 s")
    status = (await http.get("/api/status")).json()
    assert status["engine"]["state"] == "failed"
    assert "did not respond" in status["engine"]["reason"]
    assert (await http.get("/readyz")).status_code == 503
    assert (await http.get("/healthz")).is_success
