"""Calibrations by REST: kept, used, refused, and given to a source that has none."""

from __future__ import annotations

from typing import Any

from app.contract.commands import OpenSource


def upload(text: str | bytes, name: str = "cal.yaml") -> dict[str, Any]:
    return {"files": {"file": (name, text, "application/yaml")}}


async def test_a_calibration_from_upload_to_use(
    http: Any, peer: Any, calibration_yaml: Any
) -> None:
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
    # The run still refers to it, so it can be downloaded, but no longer used.
    assert (await http.get(f"/api/calibrations/{id}/file")).text == text
    assert (await http.get(f"/api/calibrations/{id}/preview")).status_code == 404
    assert (await http.get(f"/api/calibrations/{'0' * 64}/file")).status_code == 404


BAD_CALIBRATIONS = {
    "empty": b"",
    "jpeg": b"\xff\xd8\xff\xe0",
    "words": b"hello",
    "incomplete": b"image_width: 512\nimage_height: 256\n",
    "alias bomb": b"a: &a [x,x]\nb: &b [*a,*a,*a]\nc: &c [*b,*b,*b]\nd: [*c,*c,*c]\n",
    "python object": b"!!python/object/apply:os.system ['true']",
    "xml entity": b"<!DOCTYPE x [<!ENTITY a 'b'>]><opencv_storage>&a;</opencv_storage>",
}


async def test_a_run_keeps_the_calibration_of_its_source(http: Any, calibration_yaml: Any) -> None:
    started = (await http.post("/api/runs", json={})).json()
    await http.post(f"/api/runs/{started['id']}/stop")
    kept = (await http.get(f"/api/runs/{started['id']}")).json()["calibration_id"]
    assert kept is not None
    assert kept == started["calibration_id"]
    file = await http.get(f"/api/calibrations/{kept}/file")
    assert file.text == calibration_yaml()
    assert (await http.get("/api/calibrations")).json() == []
    assert (await http.post(f"/api/calibrations/{kept}/activate")).status_code == 404


async def test_bad_calibrations_are_refused_with_a_short_reason(http: Any) -> None:
    for name, content in BAD_CALIBRATIONS.items():
        answer = await http.post("/api/calibrations", **upload(content))
        assert answer.status_code == 422, (name, answer.text)
        (problem,) = answer.json()["detail"]
        assert problem["loc"] == ["body", "file"]
        assert 10 < len(problem["msg"]) < 400, name
    assert (await http.get("/api/calibrations")).json() == []


async def test_a_source_without_calibration_can_be_opened_with_one(
    serve: Any, peer: Any, calibration_yaml: Any
) -> None:
    async with serve(source="uncalibrated") as served:
        assert (await served.http.get("/api/status")).json()["engine"]["state"] == "failed"
        entry = (await served.http.post("/api/calibrations", **upload(calibration_yaml()))).json()
        body = {"source": "uncalibrated", "calibration": entry["id"]}
        answer = await served.http.put("/api/source", json=body)
        assert answer.json()["engine"]["state"] == "preview"
        assert peer.opened.source == "uncalibrated"


async def test_activating_a_calibration_opens_a_source_that_lacked_one(
    serve: Any, peer: Any, calibration_yaml: Any
) -> None:
    async with serve(source="uncalibrated") as served:
        entry = (await served.http.post("/api/calibrations", **upload(calibration_yaml()))).json()
        answer = await served.http.post(f"/api/calibrations/{entry['id']}/activate")
        assert answer.json()["engine"]["state"] == "preview"
        assert isinstance(peer.opened, OpenSource)


async def test_notes_on_a_sources_calibration_are_warnings(http: Any, peer: Any) -> None:
    told = "calibration of a folder: calibration.yaml: D1 was replaced"
    peer.publish(peer.state(calibration_notes=(told,)))
    assert (await http.get("/api/status")).json()["warnings"] == [told]
    peer.publish(peer.state())
    assert (await http.get("/api/status")).json()["warnings"] == []
