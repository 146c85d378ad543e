"""Making a calibration over REST, with a peer engine and the real worker."""

from __future__ import annotations

import asyncio
import contextlib
import io
import json
import time
import zipfile
from collections.abc import Callable
from typing import Any
from xml.etree import ElementTree

import cv2
import numpy as np
import psutil
import pytest

from app.contract.commands import BeginCalibration
from app.runtime.jobs import Progress
from app.server.calibrating import computation
from app.workers.calibration.messages import Fitted, FitViews
from observer.calibration.formats.opencv_file import calibration_id

from .wire import JSON, UPLOAD_HEAD

CAMERAS = {"source": "simulated:calibration"}
BOARD = {"kind": "chessboard", "columns": "9", "rows": "6", "square_mm": "25"}


async def facts(http: Any) -> Any:
    return (await http.get("/api/calibrating")).json()["calibrating"]


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


def archive(entries: dict[str, bytes]) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as zipped:
        for name, content in entries.items():
            zipped.writestr(name, content)
    return file.getvalue()


def picture(shift: int) -> bytes:
    """A chessboard of 9x6 inner corners that faces the camera."""
    squares = np.where(np.add.outer(np.arange(9), np.arange(12)) % 2 == 0, 20, 235)
    squares[[0, -1]] = squares[:, [0, -1]] = 235
    image = np.full((240, 320), 128, np.uint8)
    image[30:210, 40 - shift : 280 - shift] = np.kron(squares, np.ones((20, 20)))
    return cv2.imencode(".png", cv2.GaussianBlur(image, (0, 0), 0.8))[1].tobytes()


PAIR = {"left/1.png": picture(0), "right/1.png": picture(12)}


def images(content: bytes, **fields: str) -> dict[str, Any]:
    return {
        "files": {"file": ("images.zip", content, "application/zip")},
        "data": {**BOARD, **fields},
    }


# --- the whole way --------------------------------------------------------------------------


async def test_a_board_becomes_the_calibration_in_use(http: Any, peer: Any, quick: str) -> None:
    assert await facts(http) is None
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
    told = await facts(http)
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
    while (await facts(http))["result"] is None:
        await asyncio.sleep(0.01)
    result = (await http.get("/api/calibrating/result")).json()
    assert result == {"views": ["1", "3"], "report": {"stereo_rms_px": 0.2, "views": 2}}
    preview = await http.get("/api/calibrating/preview")
    assert preview.headers["x-vertical-error-px"] == "0.125"

    kept = await http.post("/api/calibrating/save", json={"name": "Bänk", "activate": False})
    assert kept.status_code == 201, kept.text
    assert (kept.json()["name"], kept.json()["active"]) == ("Bänk", False)
    assert await facts(http) is not None
    used = (await http.post("/api/calibrating/save", json={"name": "Bench"})).json()
    assert (used["id"], used["active"]) == (calibration_id(quick), True)
    assert used["origin"] == "calibrated here"
    assert used["report"]["stereo_rms_px"] == 0.2
    assert await facts(http) is None
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
    assert await facts(http) is None
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
    before = await facts(http)
    for method, path, body in BAD_BODIES:
        answer = await http.request(method, f"/api/calibrating{path}", content=body, headers=JSON)
        assert answer.status_code == 422, (path, body, answer.text)
        assert answer.json()["detail"][0]["loc"][0] == "body", body
        assert await facts(http) == before
    for path in ("views/1/middle.jpg", f"views/{'x' * 201}/left.jpg"):
        assert (await http.get(f"/api/calibrating/{path}")).status_code == 422
    for path in ("views/..%2f1/left.jpg", "views/%00/left.jpg", "views/1/left.png"):
        assert (await http.get(f"/api/calibrating/{path}")).status_code == 404
    assert peer.calibrating is not None


# --- images sent in -------------------------------------------------------------------------


async def test_uploaded_images_are_examined(http: Any) -> None:
    sent = archive({**PAIR, "readme.txt": b"x"})
    answer = await http.post("/api/calibrating/images", **images(sent))
    assert answer.status_code == 200, answer.text
    told = answer.json()["calibrating"]
    assert (told["source"], told["size"]) == (None, [320, 240])
    assert told["views"] == [{"name": "1", "left": 54, "right": 54, "picture": True}]
    assert told["refused"] == ["readme.txt is not an image (PNG, JPEG, BMP, PGM, TIFF or WebP)"]
    jpeg = await http.get("/api/calibrating/views/1/left.jpg")
    assert jpeg.content.startswith(b"\xff\xd8")
    # A file that is no archive leaves the images in place.
    refused = await http.post("/api/calibrating/images", **images(b"hello"))
    assert refused.status_code == 422
    (problem,) = refused.json()["detail"]
    assert problem["loc"] == ["body", "file"]
    assert "left/ and right/" in problem["msg"]
    assert await facts(http) == told


async def test_form_fields_with_the_images_are_validated(http: Any) -> None:
    bad = {
        "kind": ["circles", ""],
        "columns": ["2", "31", "9.5", "true", "nan", "1e999"],
        "rows": ["", "-1"],
        "square_mm": ["nan", "inf", "1e999", "-25", "0", "501", "true"],
    }

    for key, values in bad.items():
        for value in values:
            answer = await http.post("/api/calibrating/images", **images(b"x", **{key: value}))
            assert answer.status_code == 422, (key, value, answer.text)
            assert answer.json()["detail"][0]["loc"] == ["body", key], (key, value)
    assert (await http.post("/api/calibrating/images", data=BOARD)).status_code in (415, 422)
    assert await facts(http) is None


def nested() -> bytes:
    return archive({**PAIR, "inner.zip": archive(PAIR)})


def link() -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as zipped:
        entry = zipfile.ZipInfo("left/1.png")
        entry.create_system, entry.external_attr = 3, 0o120777 << 16
        zipped.writestr(entry, "/etc/passwd")
    return file.getvalue()


def encrypted() -> bytes:
    content = bytearray(archive(PAIR))
    content[content.find(b"PK\x01\x02") + 8] |= 1
    return bytes(content)


HARMFUL: dict[str, Callable[[], bytes]] = {
    "bomb": lambda: archive({"left/1.png": bytes(200_000_000), "right/1.png": b"x"}),
    "nested": nested,
    "link": link,
    "encrypted": encrypted,
    "outside": lambda: archive({**PAIR, "../../canary.png": b"x"}),
}


async def test_harmful_archives_are_refused_immediately(http: Any) -> None:
    children = psutil.Process().children()
    for name, make in HARMFUL.items():
        sent = make()
        begin = time.monotonic()
        before = psutil.Process().memory_info().rss
        answer = await http.post("/api/calibrating/images", **images(sent))
        took = time.monotonic() - begin
        assert answer.status_code == 422, (name, answer.text)
        assert answer.json()["detail"][0]["loc"] == ["body", "file"]
        assert took < 2, name
        # Nothing is expanded, and no worker was started to do so.
        assert psutil.Process().memory_info().rss - before < 50 * 2**20, name
        assert psutil.Process().children() == children
    assert await facts(http) is None


@pytest.mark.parametrize("announced", [True, False])
async def test_an_oversized_archive_uses_little_memory(
    serve: Any, token: str, announced: bool
) -> None:
    async with serve(images_max_bytes=20 * 2**20) as served:
        process = psutil.Process()
        before = process.memory_info().rss
        reader, writer = await asyncio.open_connection("127.0.0.1", served.port)
        head = [
            "POST /api/calibrating/images HTTP/1.1",
            f"Host: 127.0.0.1:{served.port}",
            f"Authorization: Bearer {token}",
            "Content-Type: multipart/form-data; boundary=x",
            f"Content-Length: {2 * 1024**3}" if announced else "Transfer-Encoding: chunked",
        ]
        writer.write("\r\n".join([*head, "", ""]).encode())
        parts = [UPLOAD_HEAD.ljust(65536, b"x"), *(600 * [b"x" * 65536])]
        answer = asyncio.ensure_future(reader.readline())
        most = 0
        with contextlib.suppress(ConnectionError):
            for part in parts:
                writer.write(part if announced else b"10000\r\n" + part + b"\r\n")
                await writer.drain()
                most = max(most, process.memory_info().rss)
        assert b" 413 " in await answer
        assert most - before < 20 * 1024**2
        writer.close()
        assert (await served.http.get("/api/status")).is_success


async def test_each_path_has_its_own_size_limit(serve: Any) -> None:
    async with serve(
        images_max_bytes=1000000, calibration_max_bytes=300000, body_max_bytes=200000
    ) as served:
        http = served.http
        large = b"x" * 400_000
        # More than a calibration file may have, less than images.
        sent = await http.post("/api/calibrating/images", **images(large))
        assert sent.status_code == 422
        calibration = {"files": {"file": ("c.yaml", large, "application/yaml")}}
        assert (await http.post("/api/calibrations", **calibration)).status_code == 413
        more = await http.post("/api/calibrating/images", **images(large * 3))
        assert more.status_code == 413
        body = json.dumps({"name": "x" * 400_000})
        for method, path in (("POST", ""), ("PATCH", ""), ("POST", "/save"), ("POST", "/compute")):
            answer = await http.request(
                method, f"/api/calibrating{path}", content=body, headers=JSON
            )
            assert answer.status_code == 413, path


# --- boards and devices ---------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["chessboard", "charuco"])
async def test_boards_are_served_for_printing(http: Any, kind: str) -> None:
    assert (await http.get("/api/boards/chessboard.pdf")).status_code == 200, (
        "the default fits on A4"
    )
    query = {"columns": 7, "rows": 5, "square_mm": 22.5, "paper": "Letter"}
    svg = await http.get(f"/api/boards/{kind}.svg", params=query)
    assert svg.headers["content-type"].startswith("image/svg+xml")
    assert f"board-{kind}-7x5-22.5mm.svg" in svg.headers["content-disposition"]
    root = ElementTree.fromstring(svg.text)
    assert {root.get("width"), root.get("height")} == {"215.9mm", "279.4mm"}
    pdf = await http.get(f"/api/boards/{kind}.pdf", params=query)
    assert pdf.headers["content-type"] == "application/pdf"
    assert pdf.content.startswith(b"%PDF-")


async def test_boards_that_cannot_be_printed_are_refused(http: Any) -> None:
    get = http.get
    large = await get("/api/boards/chessboard.svg?columns=20&rows=14&square_mm=30")
    assert large.status_code == 422
    (problem,) = large.json()["detail"]
    assert problem["loc"] == ["query", "square_mm"]
    assert "mm" in problem["msg"]
    for query in (
        *("columns=2", "columns=31", "rows=nan", "square_mm=nan", "square_mm=inf"),
        *("square_mm=1e999", "square_mm=0", "square_mm=true", "paper=A5", "columns=9.5"),
    ):
        answer = await get(f"/api/boards/chessboard.pdf?{query}")
        assert answer.status_code == 422, query
        assert answer.json()["detail"][0]["loc"][0] == "query", query
    for path in ("circles.svg", "chessboard.png"):
        assert (await get(f"/api/boards/{path}")).status_code == 422


async def test_devices_are_listed_on_a_machine_without_cameras(
    http: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    answer = await http.get("/api/devices")
    assert answer.status_code == 200
    told = answer.json()
    assert set(told) == {"cameras", "serial_ports", "hints"}
    monkeypatch.setattr("app.http.api.devices.list_devices", lambda: ())
    monkeypatch.setattr("app.http.api.devices.find_serial_ports", lambda _: ())
    none = await http.get("/api/devices")
    assert none.json() == {"cameras": [], "serial_ports": [], "hints": []}
