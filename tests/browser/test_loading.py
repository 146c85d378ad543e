"""Loading after the first painted frame: what comes before it, and what is needed early."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import pytest
from playwright.sync_api import Page, Route, expect

from .conftest import DESKTOP, KeepPicture, OpenPanel, Server

_PHONE = {"width": 390, "height": 844}
# Modules to hold back.
_PAGES = "**/static/app/pages/pages-view.js"
_WIZARD = "**/static/app/calibration/wizard.js"
_CHART = "**/static/app/chart/speed-chart.js"
_FORM = "**/static/app/parameters/parameter-form.js"
_LATER = "**/static/app/{calibration,chart,pages,method}/**"
# What the style says after an element.
_AFTER = "(each) => getComputedStyle(each, '::after').content"


def _hold(page: Page, pattern: str) -> Callable[[], None]:
    """Hold back the modules matching a pattern; the returned function releases them."""
    held: list[Route] = []

    def keep(route: Route) -> None:
        held.append(route)

    page.route(pattern, keep)

    def let_go() -> None:
        page.unroute(pattern)
        while held:
            held.pop().continue_()

    return let_go


def _reload(page: Page) -> None:
    page.reload()
    page.wait_for_selector('html[data-freshness="fresh"]', timeout=30_000)


def test_stop_and_live_data_do_not_wait_for_later_modules(
    server: Server, open_panel: OpenPanel
) -> None:
    page = open_panel()
    _hold(page, _LATER)
    _hold(page, _FORM)
    _reload(page)
    page.locator("#stop-robots").click()
    try:
        expect(page.locator(".stop-latched")).to_be_visible()
    finally:
        server.api.post("/api/robots/reset")
    expect(page.locator("observer-parameters")).to_be_empty()
    page.keyboard.press("?")
    expect(page.get_by_role("dialog", name="Keyboard")).to_be_visible()


@pytest.mark.parametrize("size", [DESKTOP, _PHONE], ids=["desktop", "phone"])
def test_a_page_opened_before_its_module_loads_appears_afterwards(
    open_panel: OpenPanel, size: Any
) -> None:
    page = open_panel(viewport=size)
    let_go = _hold(page, _PAGES)
    _reload(page)
    page.get_by_role("tab", name="Runs").click()
    page.get_by_role("link", name="All runs").click()
    let_go()
    title = page.locator("#page-title")
    expect(title).to_be_visible()
    expect(title).to_be_focused()
    page.get_by_role("button", name="Back to live").click()
    expect(page.locator("observer-live-views")).to_be_visible()


def test_the_wizard_opened_before_its_module_loads_appears_afterwards(
    open_panel: OpenPanel,
) -> None:
    page = open_panel()
    let_go = _hold(page, _WIZARD)
    _reload(page)
    page.get_by_role("tab", name="Calibration").click()
    page.get_by_role("button", name="Calibrate cameras").click()
    let_go()
    expect(page.get_by_role("heading", name="Calibrate: Board")).to_be_focused()
    page.get_by_role("button", name="Exit").click()


def test_a_module_that_fails_to_load_is_reported_and_retried(open_panel: OpenPanel) -> None:
    page = open_panel(losses=True)
    page.route(_FORM, lambda route: route.abort())
    _reload(page)
    notice = page.get_by_text("Part of this page did not load.")
    expect(notice).to_be_visible()
    # A repeated failure is reported only once.
    with page.expect_event("requestfailed"):
        page.get_by_role("tab", name="Robots").click()
        page.get_by_role("tab", name="Parameters").click()
    page.evaluate("() => new Promise((done) => setTimeout(done, 200))")
    expect(notice).to_have_count(1)
    page.unroute(_FORM)
    page.get_by_role("tab", name="Robots").click()
    page.get_by_role("tab", name="Parameters").click()
    expect(page.get_by_role("searchbox", name="Find parameters")).to_be_visible()


def test_the_speeds_of_a_paused_source_appear_once_the_chart_loads(
    server: Server, open_panel: OpenPanel, keep_picture: KeepPicture
) -> None:
    page = open_panel()
    let_go = _hold(page, _CHART)
    _reload(page)
    expect(page.locator("observer-obstacles .row-button").first).to_be_visible(timeout=30_000)
    chart = page.locator("observer-speed-chart")
    expect(chart).to_have_text(re.compile(r"^\s*Speed\s+Loading…\s*$"))
    keep_picture(page, "speed-chart-loading")
    server.api.post("/api/playback", json={"paused": True}).raise_for_status()
    try:
        page.wait_for_selector('html[data-freshness="held"]')
        let_go()
        expect(chart.locator("ul.legend")).to_contain_text("Obstacle")
        expect(chart).not_to_contain_text("Loading")
    finally:
        server.api.post("/api/playback", json={"paused": False}).raise_for_status()


def test_a_panel_that_is_still_loading_keeps_the_focus(open_panel: OpenPanel) -> None:
    page = open_panel()
    let_go = _hold(page, "**/static/app/calibration/calibration-panel.js")
    _reload(page)
    page.get_by_role("tab", name="Calibration").click()
    page.keyboard.press("Tab")
    panel = page.get_by_role("tabpanel", name="Calibration")
    expect(panel).to_be_focused()
    expect(panel).to_have_attribute("aria-busy", "true")
    assert panel.evaluate(_AFTER) == '"Loading…"'
    let_go()
    expect(panel).not_to_have_attribute("aria-busy", "true")
    assert panel.evaluate(_AFTER) == "none"
    expect(panel).to_be_focused()
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.closest('[role=tabpanel]')?.id") == panel.evaluate(
        "each => each.id"
    )
    expect(panel).not_to_have_attribute("tabindex", "0")
