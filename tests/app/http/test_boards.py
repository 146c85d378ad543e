"""Boards for printing, and the devices found."""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree

import pytest


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
