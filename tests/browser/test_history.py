"""Stored runs: searched, labelled, played, compared with ground truth, re-run, restored."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import expect

from .conftest import Eventually, KeepPicture, OpenPanel, Pixels, Server

# The server processes recordings in a process of the lowest priority.
_MADE_MS = 60_000


def _kept(server: Server, eventually: Eventually, **more: str) -> Iterator[str]:
    """Make a run of some frames; none is left behind."""
    started = server.api.post("/api/runs", json={"name": "ride", **more}).json()
    eventually(lambda: server.get(f"/runs/{started['id']}")["frames"] > 8, 30)
    server.api.post(f"/api/runs/{started['id']}/stop")
    yield started["id"]
    server.api.post("/api/playback", json={"paused": False})
    for run in server.get("/history")["runs"]:
        server.api.delete(f"/api/runs/{run['id']}")


@pytest.fixture
def kept_run(server: Server, eventually: Eventually) -> Iterator[str]:
    yield from _kept(server, eventually)


@pytest.fixture
def bare_run(server: Server, eventually: Eventually) -> Iterator[str]:
    """A run without images."""
    yield from _kept(server, eventually, record="none")


def _folder(server: Server, run: str) -> Path:
    command = server.process.cmdline()
    return Path(command[command.index("--data") + 1]) / "runs" / run


def test_a_run_is_found_described_and_compared_with_truth(
    server: Server,
    open_panel: OpenPanel,
    bare_run: str,
    plant_ride: Callable[[Path, str, Path], None],
    eventually: Eventually,
    keep_picture: KeepPicture,
    tmp_path: Path,
) -> None:
    plant_ride(_folder(server, bare_run), bare_run, tmp_path / "capture.csv")
    page = open_panel()
    # Live data are not needed here, and processing them would slow the test down.
    server.api.post("/api/playback", json={"paused": True})
    page.get_by_role("tab", name="Runs").click()
    page.get_by_role("link", name="All runs").click()
    expect(page.locator("#page-title")).to_be_focused()
    search, rows = page.get_by_label("Find runs"), page.locator(".run-rows li")
    search.fill("no such words")
    expect(page.locator("observer-run-search")).to_contain_text("No matching runs")
    expect(page.locator("observer-run-search")).not_to_contain_text("0 runs")
    # The newest runs are not listed again beside all runs.
    expect(page.locator(".recent-runs")).to_be_hidden()
    search.fill("rid")
    expect(page.locator("observer-run-search")).to_contain_text("1 run found")

    rows.get_by_role("link", name="ride").click()
    expect(page.locator("#page-title")).to_have_text("ride")
    page.get_by_label("Add tag").fill("figure 17, to and fro")
    page.keyboard.press("Enter")
    eventually(lambda: server.get(f"/runs/{bare_run}")["tags"] == ["figure 17", "to and fro"])
    page.get_by_role("button", name="Remove tag to and fro").click()
    page.get_by_label("Notes").fill("The cart turns once.")
    page.keyboard.press("Tab")
    eventually(lambda: server.get(f"/runs/{bare_run}")["notes"] == "The cart turns once.")
    assert server.get("/history")["tags"] == {"figure 17": 1}

    truth = page.locator("observer-alignment")
    expect(truth).to_contain_text("no ground truth to compare with", timeout=_MADE_MS)
    # Said once, where it can be added.
    assert page.locator("main").inner_text().lower().count("no ground truth") == 1
    page.set_input_files("#truth-file", tmp_path / "capture.csv")
    expect(truth.locator(".file-summary")).to_contain_text("plain CSV", timeout=_MADE_MS)
    expect(truth.locator(".file-summary tbody")).to_contain_text(re.compile(r"cart.*2680.*0\.35"))
    truth.get_by_text("Camera on the body").click()
    truth.get_by_label("Tilt, °").fill("10")
    truth.get_by_role("button", name="Align", exact=True).click()
    expect(truth).to_contain_text("x is missing. Fill in all six numbers or none.")
    # As if found by an alignment with the observer's body.
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
    # Both curves coincide: clocks 0.12 s apart would make them differ by 0.03 m/s.
    assert float(errors.locator("tbody td").nth(2).inner_text()) < 0.015
    said = server.get(f"/runs/{bare_run}/chart")["choices"]["camera_on_body"]
    assert (said["x_m"], said["tilt_deg"]) == (0.25, 10)
    keep_picture(page, "run")
    page.locator("observer-run .uplot").first.scroll_into_view_if_needed()
    keep_picture(page, "moment-truth")

    second = truth.get_by_role("group", name="Body of track 2")
    expect(second.get_by_role("button", name="cart")).to_have_attribute("aria-pressed", "true")
    second.get_by_role("button", name="unmatched").click()
    none = second.get_by_role("button", name="unmatched", pressed=True)
    expect(none).to_be_focused(timeout=_MADE_MS)
    expect(truth.locator(".matches tbody tr").nth(1)).to_contain_text("manual choice")
    assert int(errors.locator("tbody td").first.inner_text()) < samples
    assert server.get(f"/runs/{bare_run}/chart")["choices"]["camera_on_body"] == said

    page.get_by_role("button", name="Delete run", exact=True).click()
    expect(rows).to_have_count(0)
    page.get_by_label("Show deleted").check()
    page.get_by_role("button", name="Restore run ride").click()
    page.get_by_label("Show deleted").uncheck()
    expect(rows).to_contain_text("ground truth")
    page.get_by_role("button", name="Back to live").click()
    expect(page.locator("observer-speed-chart")).to_be_visible()


def test_a_run_is_reprocessed_and_compared(
    server: Server, open_panel: OpenPanel, kept_run: str, keep_picture: KeepPicture
) -> None:
    name = "ego_motion.ransac_threshold_px"
    before = server.get("/parameters")["values"][name]
    page = open_panel()
    page.evaluate(f"location.hash = '#runs/{kept_run}'")
    form = page.locator("observer-rerun")
    form.get_by_text("Change parameters").click()
    form.get_by_label("Find parameters").fill("RANSAC threshold")
    form.get_by_label("RANSAC threshold", exact=True).fill("2.5")
    page.keyboard.press("Tab")
    expect(form).to_contain_text(f"{name}: {before} → 2.5")
    live = server.get("/status")
    form.get_by_role("button", name="Re-run").click()
    form.get_by_role("link", name="Compare both").click(timeout=_MADE_MS)
    compared = page.locator("observer-run-compare")
    expect(compared.locator(".compared")).to_contain_text("2.5", timeout=_MADE_MS)
    expect(compared.locator(".chart-panel")).to_have_count(2)
    keep_picture(page, "compared")
    (again,) = (run for run in server.get("/history")["runs"] if run["rerun_of"])
    assert (again["rerun_of"], again["parameters"][name]) == (kept_run, 2.5)
    # Neither the live source nor its parameters have changed.
    assert server.get("/parameters")["values"][name] == before
    now = server.get("/status")
    assert now["source"] == live["source"]
    assert now["parameters_revision"] == live["parameters_revision"]


def test_a_cancelled_rerun_leaves_nothing(
    server: Server, open_panel: OpenPanel, kept_run: str
) -> None:
    page = open_panel()
    page.evaluate(f"location.hash = '#runs/{kept_run}'")
    form = page.locator("observer-rerun")
    expect(page.locator("observer-run-chart .uplot")).to_be_visible(timeout=_MADE_MS)
    form.get_by_role("button", name="Re-run").click()
    expect(form.locator("progress")).to_be_visible()
    form.get_by_role("button", name="Cancel").click()
    expect(form).to_contain_text("nothing was kept")
    assert [run["id"] for run in server.get("/history")["runs"]] == [kept_run]
    assert server.get("/status")["reruns"] == []


def test_image_top_view_and_chart_of_a_run_show_the_same_instant(
    server: Server,
    open_panel: OpenPanel,
    kept_run: str,
    pixels: Pixels,
    keep_picture: KeepPicture,
) -> None:
    page = open_panel()
    server.api.post("/api/playback", json={"paused": True})
    page.evaluate(f"location.hash = '#runs/{kept_run}'")
    expect(page).to_have_title(re.compile("ride"))
    player, reading = page.locator("observer-run-player"), page.locator(".chart-reading:visible")
    slider = player.get_by_role("slider", name="Position in the run")
    place, count = player.locator("output"), len(server.get(f"/runs/{kept_run}/frames")["frames"])
    expect(page.locator("observer-run-chart .uplot")).to_be_visible(timeout=_MADE_MS)
    expect(place).to_contain_text(f"frame 1 / {count}", timeout=_MADE_MS)
    assert pixels(player.locator("canvas")).std() > 8
    expect(player.locator(".top-view .camera")).to_have_count(1)

    # Pointing at the end of the chart shows the last frame, which stays when the pointer leaves.
    box = page.locator("observer-run-chart .u-over").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] - 2, box["y"] + 40)
    expect(place).to_contain_text(f"frame {count} / {count}")
    page.mouse.move(5, 5)
    expect(reading).to_contain_text(str(place.inner_text()).split(" s")[0][:-1])
    slider.press("Home")
    expect(place).to_contain_text(f"frame 1 / {count}")
    slider.press("ArrowRight")
    expect(place).to_contain_text(f"frame 2 / {count}")
    seconds = server.get(f"/runs/{kept_run}/frames")["frames"][1]["plan"]["time"]
    expect(reading).to_contain_text(f"{seconds:.2f} s")
    keep_picture(page, "run-page")
    # Also by keys in the chart.
    page.locator("observer-run-chart .chart").focus()
    for _ in range(10):
        page.keyboard.press("ArrowRight")
    expect(place).not_to_contain_text("frame 2 /")
    # On a portrait tablet the image, twice as wide as high, fills its place.
    page.set_viewport_size({"width": 768, "height": 1024})
    image = player.locator("canvas").bounding_box()
    assert image is not None
    assert image["width"] / image["height"] == pytest.approx(2, abs=0.05)

    slider.press("Home")
    player.get_by_role("button", name="Play").click()
    expect(player.get_by_role("button", name="Play")).to_be_visible(timeout=_MADE_MS)
    expect(place).to_contain_text(f"frame {count} / {count}")


def test_the_frames_of_a_long_run_are_loaded_on_demand(
    server: Server, open_panel: OpenPanel, kept_run: str
) -> None:
    entries = server.get(f"/runs/{kept_run}/frames")["frames"]
    page = open_panel()
    # As if a run had so many frames that only three entries are sent at first.
    page.route(
        "**/frames?most=*",
        lambda route: route.continue_(url=route.request.url.partition("?")[0] + "?most=3"),
    )
    page.evaluate(f"location.hash = '#runs/{kept_run}'")
    player = page.locator("observer-run-player")
    slider, place = player.get_by_label("Position in the run"), player.locator("output")
    expect(slider).to_be_enabled(timeout=_MADE_MS)
    expect(place).to_contain_text(f"frame 1 / {len(entries)}")
    with page.expect_response(lambda answer: "first=0&count=200" in answer.url):
        slider.fill("2")
    expect(place).to_contain_text(f"{entries[2]['plan']['time']:.2f} s · frame 3 / {len(entries)}")
    picture = player.get_by_role("img", name=f"Left image of frame {entries[2]['frame']} at")
    expect(picture).to_be_visible()
    # From any frame it is one click to the method's steps on it.
    player.get_by_role("link", name="See the method on this frame").click()
    expect(page).to_have_url(re.compile(rf"#steps/6\?source=run:{kept_run}&frame=2"))
    expect(page.locator("#steps-frame")).to_have_value("2", timeout=_MADE_MS)


def test_all_exports_of_a_run_are_in_one_menu(open_panel: OpenPanel, kept_run: str) -> None:
    page = open_panel()
    page.evaluate(f"location.hash = '#runs/{kept_run}'")
    export = page.locator("observer-run-export")
    opens = export.get_by_role("button", name="Export")
    opens.focus()
    page.keyboard.press("ArrowDown")
    items = export.get_by_role("menuitem")
    expect(items.first).to_be_focused()
    expect(items.first).to_contain_text("Report")
    page.keyboard.press("v")
    expect(export.get_by_role("menuitem", name="Video, MP4")).to_be_focused()
    page.keyboard.press("End")
    expect(items.last).to_be_focused()
    page.keyboard.press("ArrowDown")
    expect(items.first).to_be_focused()
    page.keyboard.press("Escape")
    expect(opens).to_be_focused()
    expect(export.get_by_role("menu")).to_be_hidden()

    opens.click()
    with page.expect_download() as saved:
        export.get_by_role("menuitem", name="Recording, MCAP").click()
    assert saved.value.suggested_filename == "ride.mcap"
    opens.click()
    export.get_by_role("menuitem", name="Table, CSV").click()
    page.get_by_label("Table", exact=True).select_option("frames")
    with page.expect_download(timeout=_MADE_MS) as saved:
        page.get_by_role("dialog").get_by_role("button", name="Export").click()
    assert saved.value.suggested_filename == "ride frames.csv"
    assert saved.value.path().read_text().startswith("frame")
    expect(page.locator(".export-message")).to_contain_text("exported")


def test_a_recording_is_opened_in_3d_and_closed_again(
    server: Server, open_panel: OpenPanel, kept_run: str, eventually: Eventually
) -> None:
    page = open_panel()
    page.evaluate(f"location.hash = '#runs/{kept_run}'")
    place = page.locator("observer-run-player output")
    expect(place).to_contain_text("frame 1 /", timeout=_MADE_MS)
    shown = page.get_by_role("slider", name="Position in the run")
    for _ in range(3):
        shown.press("ArrowRight")
    expect(page.locator("#open-in-3d-help")).to_contain_text("simulated:lab")
    page.get_by_role("button", name="Open in 3D").click()
    slider = page.locator("observer-playback").get_by_label("Frame", exact=True)
    expect(slider).to_be_visible(timeout=30_000)
    eventually(lambda: server.get("/status")["playback"]["frame"] == 3)
    assert server.get("/status")["source"]["name"] == "Recording of ride"
    slider.focus()
    page.keyboard.press("Home")
    eventually(lambda: server.get("/status")["playback"]["frame"] == 0)
    for _ in range(4):
        page.keyboard.press("ArrowRight")
    eventually(lambda: server.get("/status")["playback"]["frame"] == 4)
    expect(slider).to_have_attribute("aria-valuetext", re.compile("frame 4 of"))
    page.get_by_role("button", name="Back to simulated:lab").click()
    eventually(lambda: server.get("/status")["source"]["spec"] == "simulated:lab")
    expect(page.locator(".stage observer-back-to-source")).to_be_hidden()


def test_a_run_without_images_shows_only_the_top_view(open_panel: OpenPanel, bare_run: str) -> None:
    page = open_panel()
    page.evaluate("run => { location.hash = `#runs/${run}`; }", bare_run)
    player = page.locator("observer-run-player")
    expect(player).to_contain_text("has no images", timeout=_MADE_MS)
    expect(player.locator("observer-frame-picture")).to_be_hidden()
    expect(player.locator(".top-view")).to_be_visible()
    expect(page.get_by_role("button", name="Open in 3D")).to_be_hidden()
