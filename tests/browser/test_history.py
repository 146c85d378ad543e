"""Kept runs: found, described, compared with truth, re-run, brought back."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import expect

from .conftest import Eventually, KeepPicture, OpenPanel, Server

# What the server makes of a recording is made by a process of the lowest priority.
_MADE_MS = 60_000


@pytest.fixture
def kept_run(server: Server, eventually: Eventually) -> Iterator[str]:
    """A run of some frames; none is left behind."""
    started = server.api.post("/api/runs", json={"name": "ride"}).json()
    eventually(lambda: server.get(f"/runs/{started['id']}")["frames"] > 8, 30)
    server.api.post(f"/api/runs/{started['id']}/stop")
    yield started["id"]
    server.api.post("/api/playback", json={"paused": False})
    for run in server.get("/history")["runs"]:
        server.api.delete(f"/api/runs/{run['id']}")


def _folder(server: Server, run: str) -> Path:
    command = server.process.cmdline()
    return Path(command[command.index("--data") + 1]) / "runs" / run


def test_a_run_is_found_described_and_compared_with_truth(
    server: Server,
    open_panel: OpenPanel,
    kept_run: str,
    plant_ride: Callable[[Path, str, Path], None],
    eventually: Eventually,
    keep_picture: KeepPicture,
    tmp_path: Path,
) -> None:
    plant_ride(_folder(server, kept_run), kept_run, tmp_path / "capture.csv")
    page = open_panel()
    # What is live is not looked at here, and its work would be waited for.
    server.api.post("/api/playback", json={"paused": True})
    page.get_by_role("tab", name="Runs").click()
    page.get_by_role("link", name="All runs").click()
    expect(page.locator("#history-title")).to_be_focused()
    search, rows = page.get_by_label("Find runs"), page.locator(".run-rows li")
    search.fill("no such words")
    expect(page.locator("observer-run-search")).to_contain_text("No matching runs")
    search.fill("rid")
    expect(page.locator("observer-run-search")).to_contain_text("1 run found")

    rows.get_by_role("link", name="ride").click()
    expect(page.locator("#history-title")).to_have_text("Run ride")
    page.get_by_label("Add tag").fill("figure 17, to and fro")
    page.keyboard.press("Enter")
    eventually(lambda: server.get(f"/runs/{kept_run}")["tags"] == ["figure 17", "to and fro"])
    page.get_by_role("button", name="Remove tag to and fro").click()
    page.get_by_label("Notes").fill("The cart turns once.")
    page.keyboard.press("Tab")
    eventually(lambda: server.get(f"/runs/{kept_run}")["notes"] == "The cart turns once.")
    assert server.get("/history")["tags"] == {"figure 17": 1}

    truth = page.locator("observer-alignment")
    expect(truth).to_contain_text("nothing is compared", timeout=_MADE_MS)
    page.set_input_files("#truth-file", tmp_path / "capture.csv")
    expect(truth.locator(".understood")).to_contain_text("plain CSV", timeout=_MADE_MS)
    expect(truth.locator(".understood tbody")).to_contain_text(re.compile(r"cart.*2680.*0\.35"))
    truth.get_by_text("Camera on the body").click()
    truth.get_by_label("Tilt, °").fill("10")
    truth.get_by_role("button", name="Align", exact=True).click()
    expect(truth).to_contain_text("x is missing. Fill in all six numbers or none.")
    # As an alignment with the observer's body would have found it.
    found = {"x_m": 0.078, "y_m": 0.0751234, "z_m": 0.2, "pan_deg": 0.2, "tilt_deg": 4.7219}
    place = truth.locator("observer-camera-on-body")
    place.evaluate("(e, found) => { e.found = found; }", found | {"roll_deg": 0})
    place.get_by_role("button", name="Fill in the estimate").click()
    expect(truth.get_by_label("y, m")).to_have_value("0.0751")
    expect(truth.get_by_label("Tilt, °")).to_have_value("4.72")
    place.get_by_role("button", name="Estimate automatically").click()
    expect(truth.get_by_label("Tilt, °")).to_be_empty()
    truth.get_by_label("Tilt, °").fill("10")
    for words in ("x, m", "y, m", "z, m", "Pan, °", "Roll, °"):
        truth.get_by_label(words).fill("0,25")
    truth.get_by_role("button", name="Align", exact=True).click()
    expect(truth.locator(".matches tbody tr")).to_have_count(2, timeout=_MADE_MS)
    expect(truth).to_contain_text("capture.csv")
    expect(truth.locator(".figures")).to_contain_text(re.compile(r"1[12]\d\.\d ± \d\.\d ms"))
    errors = page.locator("observer-run .chart-errors")
    samples = int(errors.locator("tbody td").first.inner_text())
    said = server.get(f"/runs/{kept_run}/chart")["choices"]["camera_on_body"]
    assert (said["x_m"], said["tilt_deg"]) == (0.25, 10)
    keep_picture(page, "run")

    second = truth.get_by_role("group", name="Body of track 2")
    expect(second.get_by_role("button", name="cart")).to_have_attribute("aria-pressed", "true")
    second.get_by_role("button", name="unmatched").click()
    none = second.get_by_role("button", name="unmatched", pressed=True)
    expect(none).to_be_focused(timeout=_MADE_MS)
    expect(truth.locator(".matches tbody tr").nth(1)).to_contain_text("manual choice")
    assert int(errors.locator("tbody td").first.inner_text()) < samples
    assert server.get(f"/runs/{kept_run}/chart")["choices"]["camera_on_body"] == said

    page.get_by_role("button", name="Delete run", exact=True).click()
    expect(rows).to_have_count(0)
    page.get_by_label("Show deleted").check()
    page.get_by_role("button", name="Restore run ride").click()
    page.get_by_label("Show deleted").uncheck()
    expect(rows).to_contain_text("ground truth")
    page.get_by_role("button", name="Back to live").click()
    expect(page.locator("observer-speed-chart")).to_be_visible()


def test_a_run_is_observed_again_compared_and_played(
    server: Server,
    open_panel: OpenPanel,
    kept_run: str,
    eventually: Eventually,
    keep_picture: KeepPicture,
) -> None:
    name = "ego_motion.ransac_threshold_px"
    before = server.get("/parameters")["values"][name]
    page = open_panel()
    page.evaluate(f"location.hash = '#history/{kept_run}'")
    form = page.locator("observer-rerun")
    form.get_by_text("Change parameters").click()
    form.get_by_label("Find parameters").fill("RANSAC threshold")
    form.get_by_label("RANSAC threshold", exact=True).fill("2.5")
    page.keyboard.press("Tab")
    expect(form).to_contain_text(f"{name}: {before} → 2.5")
    form.get_by_role("button", name="Re-run").click()
    form.get_by_role("link", name="Compare both").click(timeout=_MADE_MS)
    compared = page.locator("observer-run-compare")
    expect(compared.locator(".compared")).to_contain_text("2.5", timeout=_MADE_MS)
    expect(compared.locator(".chart-panel")).to_have_count(2)
    keep_picture(page, "compared")
    (again,) = (run for run in server.get("/history")["runs"] if run["rerun_of"])
    assert (again["rerun_of"], again["parameters"][name]) == (kept_run, 2.5)

    page.evaluate(f"location.hash = '#history/{kept_run}'")
    page.get_by_role("button", name="Play recording").click()
    slider = page.get_by_label("Frame", exact=True)
    expect(slider).to_be_visible(timeout=30_000)
    page.get_by_role("button", name="Pause").click()
    eventually(lambda: server.get("/status")["playback"]["paused"])
    slider.focus()
    page.keyboard.press("Home")
    eventually(lambda: server.get("/status")["playback"]["frame"] == 0)
    for _ in range(4):
        page.keyboard.press("ArrowRight")
    eventually(lambda: server.get("/status")["playback"]["frame"] == 4)
    expect(slider).to_have_attribute("aria-valuetext", re.compile("frame 4 of"))
    assert server.api.put("/api/source", json={"source": "simulated:lab"}).is_success
    assert server.api.patch("/api/parameters", json={name: before}).is_success
