"""Making a calibration over REST, with a peer engine and the real worker."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from app.contract.commands import BeginCalibration
from app.runtime.jobs import Progress
from app.server.calibrating import computation
from app.workers.calibration.messages import Fitted, FitViews
from observer.calibration.formats.opencv_file import calibration_id

from .wire import JSON, calibrating

CAMERAS = {"source": "simulated:calibration"}


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch, calibration_yaml: Any) -> str:
    """Replace the worker by one that knows the result; return the result's text."""
    text = str(calibration_yaml())

    async def work(job: FitViews, progress: Any) -> Fitted:
        progress(Progress("fitting", 0.25))
        await asyncio.sleep(0.4)
        return Fitted(text, {"stereo_rms_px": 0.2, "views": len(job.views)})

    monkeypatch.setattr(computation, "work", work)
    return text


async def test_a_board_becomes_the_calibration_in_use(http: Any, peer: Any, quick: str) -> None:
    assert await calibrating(http) is None
    body = {**CAMERAS, "kind": "charuco", "columns": 7, "rows": 5, "square_mm": 30.5}
    started = await http.post("/api/calibrating", json=body)
    assert started.status_code == 201, started.text
    told = started.json()["calibrating"]
    assert told["source"] == CAMERAS["source"]
    assert (told["board"]["kind"], told["board"]["square_mm"]) == ("charuco", 30.5)
    assert (told["size"], told["automatic"], told["views"]) == ([512, 256], True, [])
    assert isinstance(peer.commands[-1], BeginCalibration)
    assert peer.commands[-1].board.square_m == pytest.approx(0.0305)
    for path in ("/api/calibrating/result", "/api/calibrating/preview"):
        assert (await http.get(path)).status_code == 409
    for path, more in (("compute", {}), ("save", {"name": "x"})):
        assert (await http.post(f"/api/calibrating/{path}", json=more)).status_code == 409

    peer.board_seen = True
    for _ in range(3):
        shot = await http.patch("/api/calibrating", json={"capture": True})
        assert shot.is_success, shot.text
    peer.look(words="Captured 3", coverage={"X": 0.4}, covered="left", cover_asked=True)
    told = await calibrating(http)
    assert [view["name"] for view in told["views"]] == ["1", "2", "3"]
    assert told["look"]["coverage"] == {"X": 0.4}
    assert told["look"]["cover_asked"] is True
    jpeg = await http.get("/api/calibrating/views/2/right.jpg")
    assert jpeg.headers["content-type"] == "image/jpeg"
    assert jpeg.content.startswith(b"\xff\xd8")
    removed = await http.patch("/api/calibrating", json={"remove": "2"})
    assert [view["name"] for view in removed.json()["calibrating"]["views"]] == ["1", "3"]
    assert (await http.get("/api/calibrating/views/2/left.jpg")).status_code == 404

    asked = await http.post("/api/calibrating/compute", json={"distortion_model": "radtan"})
    assert asked.status_code == 202
    # It computes from now on: another request right after it is refused.
    assert asked.json()["calibrating"]["computing"] is not None
    assert (await http.post("/api/calibrating/compute", json={})).status_code == 409
    while (await calibrating(http))["result"] is None:
        await asyncio.sleep(0.01)
    result = (await http.get("/api/calibrating/result")).json()
    assert result == {"views": ["1", "3"], "report": {"stereo_rms_px": 0.2, "views": 2}}
    preview = await http.get("/api/calibrating/preview")
    assert preview.headers["x-vertical-error-px"] == "0.125"

    kept = await http.post("/api/calibrating/save", json={"name": "Bänk", "activate": False})
    assert kept.status_code == 201, kept.text
    assert (kept.json()["name"], kept.json()["active"]) == ("Bänk", False)
    assert await calibrating(http) is not None
    used = (await http.post("/api/calibrating/save", json={"name": "Bench"})).json()
    assert (used["id"], used["active"]) == (calibration_id(quick), True)
    assert used["origin"] == "calibrated here"
    assert used["report"]["stereo_rms_px"] == 0.2
    assert await calibrating(http) is None
    assert peer.opened.source == CAMERAS["source"]
    (listed,) = (await http.get("/api/calibrations")).json()
    assert listed == used


async def test_impossible_requests_are_refused_with_a_reason(http: Any, peer: Any) -> None:
    async def refused(method: str, path: str, body: Any, status: int) -> str:
        answer = await http.request(method, f"/api{path}", json=body)
        assert answer.status_code == status, (path, body, answer.text)
        return str(answer.json()["detail"])

    nothing = "no calibration is in progress"
    assert nothing in await refused("PATCH", "/calibrating", {"capture": True}, 409)
    assert nothing in await refused("POST", "/calibrating/compute", {}, 409)
    assert (await http.post("/api/calibrating/cancel")).is_success
    assert (await http.delete("/api/calibrating")).is_success
    missing = await refused("POST", "/calibrating", {"source": "missing"}, 422)
    assert "name one that exists" in missing
    # Back to the initial state: nothing is calibrated, and the lab is observed.
    assert await calibrating(http) is None
    assert peer.opened.source == "simulated:lab"

    assert (await http.post("/api/calibrating", json=CAMERAS)).status_code == 201
    board = await refused("PATCH", "/calibrating", {"capture": True}, 409)
    assert "not visible to both cameras" in board
    assert "no view" in await refused("PATCH", "/calibrating", {"undo": True}, 409)
    assert "no view '9'" in await refused("PATCH", "/calibrating", {"remove": "9"}, 404)
    making = "a calibration is in progress"
    assert making in await refused("PUT", "/source", {"source": "a/folder"}, 409)
    assert making in await refused("POST", "/runs", {}, 409)
    assert making in await refused("POST", "/calibrations/deactivate", {}, 409)
    assert making in await refused("PUT", "/rig", {"mount": {"height_m": {"value": 0.5}}}, 409)
    assert "no source is open" in await refused("POST", "/rig/floor", {}, 409)
    peer.lose()
    await refused("PATCH", "/calibrating", {"capture": True}, 503)
    await refused("POST", "/calibrating", CAMERAS, 503)
    peer.start_process()
    while peer.calibrating is None:
        await asyncio.sleep(0.01)
    left = await http.delete("/api/calibrating")
    assert left.json()["engine"]["state"] == "preview"
    assert left.json()["calibrating"] is None

    assert (await http.post("/api/runs", json={})).status_code == 201
    assert "stop it before you calibrate" in await refused("POST", "/calibrating", {}, 409)


BAD_BODIES = [
    *(
        ("POST", "", f'{{"square_mm": {value}}}')
        for value in ("NaN", "1e999", "-Infinity", "true", '"25"', "null", "1.9", "500.1", "[]")
    ),
    *(
        ("POST", "", f'{{"columns": {value}}}')
        for value in ("true", "9.0", "2", "31", "1e999", '"9"', "NaN")
    ),
    ("POST", "", '{"kind": "circles"}'),
    ("POST", "", '{"source": ""}'),
    ("POST", "", '{"source": "a\\u0000b"}'),
    ("POST", "", '{"source": "\\ud800"}'),
    ("POST", "", '{"source": "missing"}'),
    ("POST", "", '{"unknown": 1}'),
    ("POST", "", '{"\\ud800": 1}'),
    ("POST", "", "[]"),
    ("POST", "", ""),
    ("PATCH", "", '{"capture": 1}'),
    ("PATCH", "", '{"undo": "yes"}'),
    ("PATCH", "", '{"automatic": NaN}'),
    ("PATCH", "", '{"cover_check": 0}'),
    ("PATCH", "", '{"remove": 1}'),
    ("PATCH", "", f'{{"remove": "{"x" * 201}"}}'),
    ("PATCH", "", '{"unknown": true}'),
    ("POST", "/compute", '{"distortion_model": "none"}'),
    ("POST", "/compute", '{"x": 1}'),
    ("POST", "/compute", ""),
    ("POST", "/save", "{}"),
    ("POST", "/save", '{"name": ""}'),
    ("POST", "/save", '{"name": "a\\nb"}'),
    ("POST", "/save", '{"name": "\\ud800"}'),
    ("POST", "/save", '{"name": "x", "activate": 1}'),
    ("POST", "/save", '{"name": "x", "more": 1}'),
]


async def test_bad_values_change_nothing(http: Any, peer: Any) -> None:
    assert (await http.post("/api/calibrating", json=CAMERAS)).is_success
    before = await calibrating(http)
    for method, path, body in BAD_BODIES:
        answer = await http.request(method, f"/api/calibrating{path}", content=body, headers=JSON)
        assert answer.status_code == 422, (path, body, answer.text)
        assert answer.json()["detail"][0]["loc"][0] == "body", body
        assert await calibrating(http) == before
    for path in ("views/1/middle.jpg", f"views/{'x' * 201}/left.jpg"):
        assert (await http.get(f"/api/calibrating/{path}")).status_code == 422
    for path in ("views/..%2f1/left.jpg", "views/%00/left.jpg", "views/1/left.png"):
        assert (await http.get(f"/api/calibrating/{path}")).status_code == 404
    assert peer.calibrating is not None
