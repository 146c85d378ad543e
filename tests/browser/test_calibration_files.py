"""Calibrations of other tools in the panel: previewed before use, refused with a reason."""

from __future__ import annotations

import io
import re
import zipfile
from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import FilePayload, Page, expect

from .conftest import Eventually, Json, KeepPicture, OpenPanel, Server


@pytest.fixture(scope="module", autouse=True)
def _as_before(server: Server) -> Iterator[None]:
    """Leave no calibration for other tests."""
    yield
    for kept in server.get("/calibrations"):
        server.api.delete(f"/api/calibrations/{kept['id']}").raise_for_status()


def _choose(page: Page, **files: str) -> None:
    payloads: list[FilePayload] = [
        {"name": f"{name}.yaml", "mimeType": "application/yaml", "buffer": text.encode()}
        for name, text in files.items()
    ]
    page.set_input_files("#calibration-file", files=payloads)


def _camchain(camera: Json, baseline: str) -> str:
    one = f"""\
  camera_model: pinhole
  distortion_model: radtan
  distortion_coeffs: [0.0, 0.0, 0.0, 0.0]
  intrinsics: [{camera["fx"]}, {camera["fy"]}, {camera["cx"]}, {camera["cy"]}]
  resolution: [{camera["width"]}, {camera["height"]}]
"""
    return f"cam0:\n{one}cam1:\n{one}{baseline}"


def _kalibr_baseline(camera: Json) -> str:
    rows = [f"[1.0, 0.0, 0.0, {-camera['baseline']}]", "[0.0, 1.0, 0.0, 0.0]",
            "[0.0, 0.0, 1.0, 0.0]", "[0.0, 0.0, 0.0, 1.0]"]  # fmt: skip
    return "  T_cn_cnm1:\n" + "".join(f"  - {row}\n" for row in rows)


def _ros(camera: Json, name: str, shift: float) -> str:
    fx, fy, cx, cy = (camera[key] for key in ("fx", "fy", "cx", "cy"))
    return f"""\
image_width: {camera["width"]}
image_height: {camera["height"]}
camera_name: {name}
camera_matrix: {{rows: 3, cols: 3, data: [{fx}, 0, {cx}, 0, {fy}, {cy}, 0, 0, 1]}}
distortion_model: plumb_bob
distortion_coefficients: {{rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}}
rectification_matrix: {{rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}}
projection_matrix:
  {{rows: 3, cols: 4, data: [{fx}, 0, {cx}, {shift * fx}, 0, {fy}, {cy}, 0, 0, 0, 1, 0]}}
"""


@pytest.fixture
def camera(server: Server, eventually: Eventually) -> Any:
    """The rectified pair of the lab, with no calibration stored."""
    eventually(lambda: server.get("/status")["source"], 40)
    status = server.get("/status")
    if status["source"]["spec"] != "simulated:lab" or status["calibration"]:
        server.api.put("/api/source", json={"source": "simulated:lab"}).raise_for_status()
    for kept in server.get("/calibrations"):
        server.api.delete(f"/api/calibrations/{kept['id']}").raise_for_status()
    return eventually(lambda: server.get("/status")["camera"], 20)


def test_files_of_other_tools_are_previewed_before_use(
    server: Server, open_panel: OpenPanel, camera: Json, keep_picture: KeepPicture
) -> None:
    page = open_panel()
    page.get_by_role("tab", name="Calibration").click()
    preview = page.get_by_role("dialog")
    _choose(page, camchain=_camchain(camera, _kalibr_baseline(camera)))
    expect(preview).to_contain_text("Kalibr")
    expect(preview).to_contain_text(f"{camera['baseline']:.4f} m")
    expect(preview.locator(".verdict").last).to_have_text(re.compile(r"Epipolar error 0\.\d\d px"))
    keep_picture(page, "calibration-kalibr")
    preview.get_by_role("button", name="Close").click()

    _choose(
        page,
        left=_ros(camera, "narrow_stereo/left", 0.0),
        right=_ros(camera, "narrow_stereo/right", -2 * camera["baseline"]),
    )
    expect(preview).to_contain_text("ROS")
    expect(preview).to_contain_text(f"{2 * camera['baseline']:.4f} m")
    preview.get_by_role("button", name="Close").click()
    expect(preview).to_have_count(0)
    assert server.get("/status")["calibration"] is None
    assert len(server.get("/calibrations")) == 2

    page.get_by_role("button", name="Rename calibration camchain.yaml").click()
    expect(preview.get_by_role("button")).to_have_text(["Cancel", "Save"])
    preview.get_by_label("Name", exact=True).fill("Of Kalibr")
    page.keyboard.press("Enter")
    expect(page.get_by_role("button", name="Preview calibration Of Kalibr")).to_be_visible()
    # The renamed entry had the focus and still has it.
    page.wait_for_function(
        "() => document.activeElement.ariaLabel === 'Rename calibration Of Kalibr'", timeout=5_000
    )

    # Beside its buttons a name would be broken within words.
    words = page.locator("observer-calibration .item-words").first.bounding_box()
    assert words is not None
    assert words["width"] > 170

    page.get_by_role("button", name="Compare").click()
    table = page.get_by_role("dialog").get_by_role("table")
    expect(table).to_contain_text("Of Kalibr")
    expect(table).to_contain_text("left.yaml and right.yaml")
    rows = table.get_by_role("row", name=re.compile("Epipolar error now")).get_by_role("cell")
    expect(rows).to_have_text([re.compile(r"\d\.\d\d px"), re.compile(r"\d\.\d\d px")])
    base = table.get_by_role("row", name=re.compile("Baseline")).get_by_role("cell")
    lengths = [f"{1000 * factor * camera['baseline']:.1f} mm" for factor in (2, 1)]
    expect(base).to_have_text(lengths)
    keep_picture(page, "calibrations-compared")
    page.keyboard.press("Escape")

    page.get_by_role("button", name="Preview calibration Of Kalibr").click()
    contents = {}
    for tool in ("OpenCV", "ROS", "Kalibr"):
        with page.expect_download() as coming:
            preview.get_by_role("link", name=f"Download for {tool}").click()
        contents[tool] = coming.value.path().read_bytes()
    assert contents["OpenCV"].startswith(b"%YAML")
    assert b"T_cn_cnm1" in contents["Kalibr"]
    with zipfile.ZipFile(io.BytesIO(contents["ROS"])) as archive:
        sides = [name.rpartition("-")[2] for name in sorted(archive.namelist())]
    assert sides == ["left.yaml", "right.yaml"]
    page.keyboard.press("Escape")
    expect(preview).to_have_count(0)


def test_a_refused_file_names_the_key_and_the_reason(
    server: Server, open_panel: OpenPanel, camera: Json
) -> None:
    page = open_panel(refusals=True)
    page.get_by_role("tab", name="Calibration").click()
    _choose(page, camchain=_camchain(camera, ""))
    error = page.locator("#calibration-error")
    expect(error).to_contain_text("camchain.yaml not imported")
    expect(error).to_contain_text("T_cn_cnm1")
    assert server.get("/calibrations") == []
    # The same file can be chosen again once corrected.
    _choose(page, camchain=_camchain(camera, _kalibr_baseline(camera)))
    expect(page.get_by_role("dialog")).to_contain_text("Kalibr")
    expect(error).to_be_empty()
    page.keyboard.press("Escape")


def test_a_missing_unit_is_requested_next_to_its_field(open_panel: OpenPanel, camera: Json) -> None:
    page = open_panel(refusals=True)
    page.get_by_role("tab", name="Calibration").click()
    unit = page.get_by_label("Unit", exact=True)
    expect(unit).to_be_hidden()
    baseline = _kalibr_baseline({"baseline": 1000 * camera["baseline"]})
    millimetres = _camchain(camera, baseline)
    _choose(page, camchain=millimetres)
    expect(page.locator("#calibration-error")).to_contain_text("set unit to mm")
    expect(unit).to_be_focused()
    unit.fill("mm")
    _choose(page, camchain=millimetres)
    expect(page.get_by_role("dialog")).to_contain_text(f"{camera['baseline']:.4f} m")
    page.keyboard.press("Escape")
