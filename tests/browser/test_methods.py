"""Two methods compared on the same frames, side by side."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Locator, Page, expect

from .conftest import Eventually, KeepPicture, OpenPanel, Server

# The frames are processed by a process of the lowest priority.
_MADE_MS = 120_000
_PICTURES = """panes => panes.map(pane => pane.querySelector('canvas').toDataURL())"""

# Labels of obstacles that cover another one by more than their outlines.
_COVERED = """panes => panes.flatMap(pane => {
  const areas = [...pane.querySelectorAll('svg text')].map(e => e.getBoundingClientRect());
  return areas.flatMap((a, at) => areas.slice(at + 1).filter(b =>
    Math.min(a.right, b.right) - Math.max(a.left, b.left) > 2 &&
    Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 4).map(b => [a.x, a.y, b.x, b.y]));
})"""
# Figures wider than their column.
_WIDE_FIGURES = """panes => panes.flatMap(pane => [...pane.querySelectorAll('dd')])
  .filter(each => each.scrollWidth > each.clientWidth).map(each => each.textContent)"""


@pytest.fixture(autouse=True)
def _nothing_kept(server: Server) -> Iterator[None]:
    """Cancel any comparison before the test, and leave nothing behind."""
    server.api.post("/api/comparison/cancel")
    yield
    server.api.post("/api/comparison/cancel")
    server.api.post("/api/playback", json={"paused": False})
    for run in server.get("/history")["runs"]:
        server.api.delete(f"/api/runs/{run['id']}")


def _figures(pane: Locator) -> dict[str, str]:
    names, values = pane.locator("dt").all_inner_texts(), pane.locator("dd").all_inner_texts()
    return dict(zip(names, values, strict=True))


def test_both_methods_are_compared_on_the_same_frames(
    server: Server, open_panel: OpenPanel, keep_picture: KeepPicture
) -> None:
    page = open_panel(reduced_motion="reduce")
    before = server.get("/status")["source"]["spec"]
    page.get_by_role("link", name="Compare", exact=True).click()
    view = page.locator("observer-methods")
    expect(page.locator("#page-title")).to_have_text("Compare methods")
    # The first comparison starts by itself.
    expect(view.get_by_role("progressbar")).to_be_visible(timeout=20_000)
    expect(view).to_contain_text("with default (right) on People in the lab")
    view.get_by_role("button", name="Cancel").click()
    expect(view.get_by_role("button", name="Compare methods")).to_be_focused()
    assert server.get("/runs") == []

    view.get_by_label("Seconds").fill("99")
    page.keyboard.press("Enter")
    expect(view.get_by_role("alert")).to_have_text("Seconds must be a number from 1 to 30.")
    view.get_by_label("Seconds").fill("2")
    # Live data are not needed here, and processing them would slow the test down.
    server.api.post("/api/playback", json={"paused": True})
    page.keyboard.press("Enter")
    expect(view.get_by_role("progressbar")).to_be_visible()
    conclusion = view.locator(".methods-conclusion")
    expect(conclusion).to_contain_text("On these 30 frames, paper reported", timeout=_MADE_MS)
    default, paper = server.get("/runs")
    expect(page).to_have_url(re.compile(rf"#methods/{paper['id']},{default['id']}$"))
    assert server.get("/status")["source"]["spec"] == before

    panes = view.locator(".methods-pane")
    expect(panes.locator("h3")).to_have_text(["paper", "default"])
    found = [server.get(f"/runs/{run['id']}/frames") for run in (paper, default)]
    slider = view.get_by_label("Frame", exact=True)
    slider.focus()
    page.keyboard.press("End")
    _expect_frame(view, found, 29)
    keep_picture(page, "methods")
    page.keyboard.press("Home")
    page.keyboard.press("ArrowRight")
    _expect_frame(view, found, 1)
    view.get_by_role("group", name="Both methods").focus()
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    page.keyboard.press("PageDown")
    _expect_frame(view, found, 14)
    # The address points to the same frame.
    expect(page).to_have_url(re.compile("/14$"))
    page.reload()
    _expect_frame(view, found, 14)

    view.get_by_role("group", name="Both methods").focus()
    page.keyboard.press("Space")
    expect(view.get_by_role("button", name="Pause")).to_be_visible()
    expect(view.get_by_role("button", name="Play")).to_be_visible(timeout=20_000)
    _expect_frame(view, found, 29)
    for width in (1440, 1024, 700):
        page.set_viewport_size({"width": width, "height": 800})
        assert panes.evaluate_all(_WIDE_FIGURES) == [], width

    view.get_by_role("link", name="Speeds, errors and parameters").click()
    compared = page.locator("observer-run-compare")
    compared.get_by_role("link", name="Side by side").click(timeout=_MADE_MS)
    expect(conclusion).to_be_visible()
    # Coming back shows the last comparison.
    page.evaluate("location.hash = '#methods'")
    expect(conclusion).to_be_visible()
    expect(page).to_have_url(re.compile(rf"#methods/{paper['id']},{default['id']}$"))


def _expect_frame(view: Locator, found: list[dict[str, Any]], position: int) -> None:
    """Expect both halves to show this frame with each method's detections and counts."""
    expect(view.locator(".methods-position")).to_contain_text(
        f"{position + 1} / 30", timeout=20_000
    )
    panes = view.locator(".methods-pane")
    left, right = panes.evaluate_all(_PICTURES)
    assert left == right
    assert panes.evaluate_all(_COVERED) == []
    for pane, method in zip(panes.all(), found, strict=True):
        entry = method["frames"][position]
        expect(pane.locator("svg g")).to_have_count(len(entry["obstacles"]))
        wrong = sum(each["false"] for each in entry["obstacles"])
        expect(pane.locator('svg g[data-kind="false"]')).to_have_count(wrong)
        expect(pane.locator('svg rect[data-kind="truth"]')).to_have_count(len(entry["truth"]))
        figures, counts = _figures(pane), entry["counts"]
        assert figures["False obstacles"] == str(counts["false"])
        assert figures["Found"] == f"{counts['found']} of {counts['found'] + counts['missed']}"


def test_runs_with_different_frames_are_not_shown_side_by_side(
    server: Server, open_panel: OpenPanel, eventually: Eventually
) -> None:
    ids = []
    # The second run is longer than the first.
    for name, least in (("one", 5), ("two", 20)):
        run = server.api.post("/api/runs", json={"name": name}).json()["id"]
        eventually(lambda run=run, n=least: server.get(f"/runs/{run}")["frames"] > n, 30)
        server.api.post(f"/api/runs/{run}/stop")
        # The frames are refused until the recording is complete.
        frames = f"/api/runs/{run}/frames"
        eventually(lambda path=frames: server.api.get(path).is_success, 60)
        ids.append(run)
    page = open_panel()
    page.evaluate(f"location.hash = '#methods/{ids[0]},{ids[1]}'")
    view = page.locator("observer-methods")
    expect(view.get_by_role("alert")).to_contain_text("different frames", timeout=_MADE_MS)
    expect(view.locator("observer-methods-split")).to_be_hidden()


def test_the_comparison_fits_a_phone(server: Server, open_panel: OpenPanel) -> None:
    wanted = {"source": "simulated:people", "seconds": 1}
    assert server.api.post("/api/comparison", json=wanted).is_success
    page = open_panel(viewport={"width": 360, "height": 740}, reduced_motion="reduce")
    page.evaluate("location.hash = '#methods'")
    view = page.locator("observer-methods")
    expect(view.locator(".methods-conclusion")).to_be_visible(timeout=_MADE_MS)
    first, second = (pane.bounding_box() for pane in view.locator(".methods-pane").all())
    assert first
    assert second
    assert second["y"] >= first["y"] + first["height"]
    assert _overflow(page) == []


def _overflow(page: Page) -> list[str]:
    """Return the parts of the view that exceed the window's width."""
    found: list[str] = page.evaluate(
        """() => [...document.querySelectorAll('observer-pages *')]
        .filter(e => e.checkVisibility() && e.getBoundingClientRect().right > innerWidth + 1)
        .map(e => e.outerHTML.slice(0, 120))"""
    )
    return found
