"""Runs and calibrations: stored, viewed, deleted."""

from __future__ import annotations

import re

import cv2
import numpy as np
from playwright.sync_api import FilePayload, Page, expect

from .conftest import Eventually, Json, KeepPicture, OpenPanel, Pixels, Server

_MAKE_ANEW = """label => {
  const old = document.querySelector(`[aria-label="${label}"]`);
  old.replaceWith(old.cloneNode(true));
}"""


def test_a_run_is_started_stopped_listed_and_deleted(
    server: Server, open_panel: OpenPanel, eventually: Eventually, keep_picture: KeepPicture
) -> None:
    page = open_panel()
    page.get_by_role("button", name="Run options").click()
    page.get_by_label("Run name").fill("crossing")
    page.get_by_role("button", name="Start run").press("Enter")
    expect(page.get_by_role("button", name="Stop run")).to_be_focused(timeout=10_000)
    run = eventually(lambda: server.get("/status")["run"])
    assert run["name"] == "crossing"
    eventually(lambda: server.get("/status")["engine"]["state"] == "running")
    eventually(lambda: server.get(f"/runs/{run['id']}")["frames"] > 3, 15)
    page.get_by_role("tab", name="Runs").click()
    page.get_by_role("button", name="Save last 30 s").click()
    expect(page.locator("#notices")).to_contain_text("listed under All runs")
    page.get_by_role("button", name="Stop run").press("Enter")
    expect(page.get_by_role("button", name="Start run")).to_be_focused(timeout=10_000)
    assert server.get(f"/runs/{run['id']}")["state"] == "finished"

    page.get_by_role("link", name="All runs").click()
    clips = page.locator("observer-saved-clips")
    expect(clips.get_by_role("link", name="from this run")).to_be_visible()
    keep_picture(page, "clips")
    clips.get_by_role("button", name="Play the clip").click()
    expect(page.locator("observer-playback")).to_be_visible()
    (clip,) = server.get("/recording/clips")
    assert server.get("/status")["source"]["spec"] == clip["source"]
    assert server.api.put("/api/source", json={"source": "simulated:lab"}).is_success
    page.get_by_role("link", name="All runs").click()
    clips.get_by_role("button", name="Delete the clip").click()
    page.get_by_role("button", name="Delete clip", exact=True).click()
    expect(clips.locator("li")).to_have_count(0)
    assert server.get("/recording/clips") == []
    page.get_by_role("button", name="Back to live").click()

    entry = page.locator("observer-runs li", has_text="crossing")
    expect(entry.locator(".state-chip")).to_have_count(0)
    keep_picture(page, "runs")
    csv = entry.get_by_role("link", name=re.compile("CSV")).get_attribute("href")
    rows = server.api.get(csv).text.splitlines()
    assert rows[0].startswith("time,role,source")
    assert len(rows) > 3

    entry.get_by_role("button", name="Delete run crossing").click()
    expect(entry).to_have_count(0)
    page.get_by_role("button", name="Undo").click()
    expect(entry).to_have_count(1)
    entry.get_by_role("button", name="Delete run crossing").click()
    expect(entry).to_have_count(0)
    assert server.get("/history")["total"] == 0


def _calibration_of(camera: Json) -> bytes:
    """Return the calibration of the open pair as an OpenCV file."""
    matrix = [camera["fx"], 0, camera["cx"], 0, camera["fy"], camera["cy"], 0, 0, 1]
    writer = cv2.FileStorage(
        "", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | cv2.FILE_STORAGE_FORMAT_YAML
    )
    writer.write("image_width", camera["width"])
    writer.write("image_height", camera["height"])
    for side in ("1", "2"):
        writer.write(f"K{side}", np.reshape(matrix, (3, 3)).astype(float))
        writer.write(f"D{side}", np.zeros((1, 5)))
    writer.write("R", np.eye(3))
    writer.write("T", np.array([[-camera["baseline"]], [0.0], [0.0]]))
    return writer.releaseAndGetString().encode()


def _choose(page: Page, name: str, content: bytes) -> None:
    file: FilePayload = {"name": name, "mimeType": "application/yaml", "buffer": content}
    page.set_input_files("#calibration-file", files=[file])


def test_a_bad_calibration_is_refused_with_a_reason(server: Server, open_panel: OpenPanel) -> None:
    page = open_panel(refusals=True)
    page.get_by_role("tab", name="Calibration").click()
    _choose(page, "holiday.yaml", b"beach: sunny\n")
    error = page.locator("#calibration-error")
    expect(error).to_contain_text("holiday.yaml not imported")
    assert error.inner_text().count("holiday.yaml") == 1
    assert len(error.inner_text()) > 50
    assert server.get("/calibrations") == []


def test_a_calibration_is_previewed_before_use(
    server: Server,
    open_panel: OpenPanel,
    eventually: Eventually,
    keep_picture: KeepPicture,
    pixels: Pixels,
) -> None:
    page = open_panel()
    page.get_by_role("tab", name="Calibration").click()
    camera = server.get("/status")["camera"]
    _choose(page, "lab.yaml", _calibration_of(camera))
    preview = page.get_by_role("dialog")
    expect(preview.locator(".verdict")).to_have_text(
        re.compile(r"Epipolar error \d+\.\d\d px"), timeout=10_000
    )
    expect(preview).to_contain_text(f"{camera['width']} × {camera['height']} px")
    expect(preview).to_contain_text(f"{camera['baseline']:.4f} m")
    assert pixels(preview.locator("canvas")).std() > 8
    keep_picture(page, "calibration")
    assert server.get("/status")["calibration"] is None

    preview.get_by_role("button", name="Use this calibration").click()
    active = eventually(lambda: server.get("/status")["calibration"])
    assert active["name"] == "lab.yaml"
    # A list that changes meanwhile takes away the button that opened the dialog.
    look = page.get_by_role("button", name="Preview calibration lab.yaml")
    look.click()
    expect(preview).to_be_visible()
    page.evaluate(_MAKE_ANEW, "Preview calibration lab.yaml")
    page.keyboard.press("Escape")
    expect(page.get_by_role("tab", name="Calibration")).to_be_focused()
    page.get_by_role("button", name="Use the source's own").click()
    eventually(lambda: server.get("/status")["calibration"] is None)
    page.get_by_role("button", name="Delete calibration lab.yaml").click()
    page.get_by_role("dialog").get_by_role("button", name="Delete calibration").click()
    eventually(lambda: server.get("/calibrations") == [])
    expect(page.locator("html")).to_have_attribute("data-freshness", "fresh", timeout=10_000)
