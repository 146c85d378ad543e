"""axe finds nothing of any severity in any state of the page: live, runs, dialogs, wizard."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, expect

from .axe import findings
from .conftest import Eventually, OpenPanel, Server, looks

_MADE_MS = 120_000
_TABS = ("Source", "Parameters", "Robots", "Calibration", "Runs", "Status")
# Without animations: half-way through one, colours are blended.
_LOOKS: dict[str, dict[str, Any]] = {
    "light": {},
    "dark": {"color_scheme": "dark"},
    "phone": {"viewport": {"width": 360, "height": 780}, "has_touch": True},
}
# Expand everything that is collapsed, so that its content is checked too.
_UNFOLD = """() => {
  for (const each of document.querySelectorAll("details"))
    if (each.checkVisibility()) each.open = true;
}"""


class _Look:
    """A page checked in one state after another; all findings are reported together.

    Dark differs from light only in its colours.
    """

    def __init__(self, page: Page, name: str) -> None:
        self.page = page
        self._name = name
        self._found: list[str] = []
        self._seen = 0

    def __call__(self, state: str) -> None:
        self._seen += 1
        found = findings(self.page, colours=self._name == "dark")
        self._found += [f"{state}: {each}" for each in found]

    def unfolded(self, state: str) -> None:
        self.page.evaluate(_UNFOLD)
        self.page.wait_for_timeout(100)
        self(state)

    @contextmanager
    def opened(self, state: str) -> Iterator[None]:
        """Check what is opened within, then close it with Escape."""
        yield
        self.page.wait_for_timeout(100)
        self(state)
        self.page.keyboard.press("Escape")

    def end(self, least: int) -> None:
        assert not self._found, "\n".join(self._found)
        assert self._seen >= least

    def go(self, place: str) -> None:
        self.page.evaluate("(place) => { location.hash = place; }", place)

    def menu(self, name: str) -> None:
        self.page.get_by_role("button", name="Menu").click()
        self.page.locator("#page-menu").get_by_role("button", name=name).click()


@pytest.fixture
def look(server: Server, open_panel: OpenPanel, request: pytest.FixtureRequest) -> Iterator[_Look]:
    """A page with live data, paused, since processing would slow the checks down."""
    page = open_panel(refusals=True, reduced_motion="reduce", **_LOOKS[request.param])
    server.api.post("/api/playback", json={"paused": True}).raise_for_status()
    page.wait_for_selector('html[data-freshness="held"]')
    yield _Look(page, request.param)
    server.api.post("/api/playback", json={"paused": False}).raise_for_status()


# The tab and the method that are selected, and one each that is not.
_BACKGROUNDS = """() => ["[role=tab]", ".segmented label"].map((each) => {
  const all = [...document.querySelectorAll(each)];
  const chosen = (one) => one.ariaSelected === "true" || one.querySelector(":checked") !== null;
  return [all.find(chosen), all.find((one) => !chosen(one))].map(
    (one) => getComputedStyle(one).backgroundColor);
})"""


def _selection_is_seen_in_contrast_themes(page: Page) -> None:
    page.emulate_media(forced_colors="active", reduced_motion="reduce")
    for selected, other in page.evaluate(_BACKGROUNDS):
        assert selected != other
    page.emulate_media(forced_colors="none", reduced_motion="reduce")


@pytest.mark.parametrize("look", looks("light", "dark"), indirect=True)
def test_live_page_and_tabs_are_accessible(look: _Look) -> None:
    page = look.page
    look("live")
    page.locator(".pixel-pick").click()
    expect(page.locator(".answer .verdict-chip")).to_be_visible(timeout=20_000)
    look("a pixel explained")
    for tab in _TABS:
        page.get_by_role("tab", name=tab).click()
        page.wait_for_timeout(100)
        look.unfolded(tab)
    _selection_is_seen_in_contrast_themes(page)

    with look.opened("menu"):
        page.get_by_role("button", name="Menu").click()
    with look.opened("tour"):
        look.menu("Take the tour")
        page.locator(".tour-card").get_by_role("button", name="Next").click()
    look.end(least=10)


@pytest.mark.parametrize("look", looks("light", of=("light", "dark")), indirect=True)
def test_dialogs_are_accessible(look: _Look) -> None:
    page = look.page
    page.get_by_role("tab", name="Source").click()
    field = page.locator("#source-spec")
    field.fill("simulated:nowhere")
    field.press("Enter")
    expect(page.locator("#source-error")).not_to_be_empty()
    with look.opened("suggested sources"):
        field.fill("simul")
        expect(page.get_by_role("option").first).to_be_visible()

    page.get_by_role("tab", name="Parameters").click()
    with look.opened("help of a parameter"):
        page.get_by_role("button", name="About RANSAC threshold").click()
    with look.opened("more about presets"):
        page.locator("observer-parameters").get_by_role("button", name="More").click()
    with look.opened("presets compared"):
        page.get_by_role("button", name="Compare…").click()
        expect(page.get_by_role("dialog", name="Compare presets")).to_be_visible()
    with look.opened("share"):
        look.menu("Share")
        expect(page.get_by_role("dialog", name="Share this page")).to_be_visible()
    with look.opened("keyboard"):
        look.menu("Keyboard")
        expect(page.get_by_role("dialog", name="Keyboard")).to_be_visible()
    look.end(least=6)


@pytest.mark.parametrize("look", looks("phone"), indirect=True)
def test_runs_methods_and_steps_are_accessible(look: _Look, two_runs: list[str]) -> None:
    page = look.page
    look.go("#runs")
    expect(page.locator(".run-rows li")).to_have_count(2)
    look.unfolded("runs")

    look.go(f"#runs/{two_runs[0]}")
    expect(page.locator("observer-run-chart .uplot")).to_be_visible(timeout=_MADE_MS)
    expect(page.locator("observer-run-player output")).to_contain_text("frame 1 /")
    look.unfolded("a run")
    with look.opened("export of a run"):
        page.locator("observer-run-export").get_by_role("button", name="Export").click()

    look.go(f"#runs/compare/{two_runs[0]},{two_runs[1]}")
    expect(page.locator("observer-run-compare .chart-panel")).to_have_count(2, timeout=_MADE_MS)
    look.unfolded("runs compared")

    look.go("#methods")
    expect(page.locator(".methods-conclusion")).to_be_visible(timeout=_MADE_MS)
    look.unfolded("methods compared")

    look.go("#steps/6?source=simulated:lab&frame=40")
    picture = page.locator("observer-steps .step-picture")
    expect(picture.locator("img")).to_be_visible(timeout=_MADE_MS)
    expect(page.locator(".step-numbers tr").first).to_be_visible(timeout=_MADE_MS)
    look.unfolded("steps")
    with look.opened("export of a step"):
        page.locator("observer-steps").get_by_role("button", name="Export").click()
    with look.opened("steps presented"):
        page.locator("#page-title").focus()
        page.keyboard.press("p")
        expect(page.locator("dialog.presentation img")).to_have_attribute("src", re.compile("blob"))
    look.end(least=8)


@pytest.mark.parametrize("look", looks("light"), indirect=True)
def test_wizard_is_accessible(server: Server, look: _Look, eventually: Eventually) -> None:
    page = look.page
    page.get_by_role("tab", name="Calibration").click()
    page.locator("observer-calibration button", has_text="Calibrate").first.click()
    expect(page.get_by_role("heading", name="Calibrate: Board")).to_be_visible()
    look.unfolded("board")
    page.get_by_label("Square, mm").fill("25")
    page.locator("#board-source").fill("simulated:calibration")
    page.get_by_role("button", name="Start with these cameras").click()
    try:
        expect(page.get_by_role("heading", name="Calibrate: Views")).to_be_visible(timeout=30_000)
        eventually(lambda: (server.get("/status")["calibrating"] or {}).get("views"), 40)
        expect(page.locator(".view-list li").first).to_be_visible()
        look.unfolded("views")
        with look.opened("exit?"):
            page.get_by_role("button", name="Exit").click()
            expect(page.get_by_role("dialog")).to_be_visible()
    finally:
        # It would request pictures of views that no longer exist.
        page.goto("about:blank")
        server.api.delete("/api/calibrating")
        server.api.put("/api/source", json={"source": "simulated:lab"}).raise_for_status()
    look.end(least=3)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_sign_in_is_accessible(server: Server, browser: Browser, scheme: Any) -> None:
    context = browser.new_context(color_scheme=scheme)
    try:
        page = context.new_page()
        page.goto(server.link.partition("?token=")[0])
        assert findings(page) == []
        page.get_by_label("Token").fill("wrong")
        page.get_by_role("button", name="Sign in").click()
        expect(page.get_by_role("alert")).to_be_visible()
        assert findings(page) == []
    finally:
        context.close()
