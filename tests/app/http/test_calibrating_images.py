"""Calibrating from uploaded images: examined, or refused with little memory."""

from __future__ import annotations

import io
import json
import time
import zipfile
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import psutil
import pytest

from .wire import JSON, calibrating, upload_gigabytes

BOARD = {"kind": "chessboard", "columns": "9", "rows": "6", "square_mm": "25"}


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
    assert await calibrating(http) == told


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
    assert await calibrating(http) is None


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
    assert await calibrating(http) is None


@pytest.mark.parametrize("announced", [True, False])
async def test_an_oversized_archive_uses_little_memory(
    serve: Any, token: str, announced: bool
) -> None:
    async with serve(images_max_bytes=20 * 2**20) as served:
        line, taken = await upload_gigabytes(
            served.port, "/api/calibrating/images", token, announced=announced
        )
        assert b" 413 " in line
        assert taken < 20 * 1024**2
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
