"""The stable frame of the page: header, stop button and panes, at every size, in every view."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import Page, ViewportSize, expect

from .conftest import TOO_WIDE, Eventually, KeepPicture, OpenPanel, Server

_SIZES: tuple[ViewportSize, ...] = (
    {"width": 360, "height": 780},
    {"width": 820, "height": 1180},
    {"width": 1024, "height": 700},
    {"width": 1440, "height": 900},
    {"width": 2560, "height": 1440},
)
_PLACES = ("#live", "#runs", "#live")
# By how much the content exceeds the window, horizontally and vertically.
_OVERFLOW = """() => {
  const { scrollWidth, scrollHeight } = document.documentElement;
  return [scrollWidth - innerWidth, scrollHeight - innerHeight];
}"""
_MAIN_OVERFLOW = """() => {
  const { scrollWidth, clientWidth } = document.querySelector("main");
  return [scrollWidth - clientWidth];
}"""
# Neighbours in the header that overlap.
_HEADER_OVERLAPS = """() => {
  const shown = [...document.querySelectorAll(".top button, .top a, .top .state-chip")]
    .filter((each) => each.checkVisibility() && !each.closest("[popover]"))
    .map((each) => [each, each.getBoundingClientRect()])
    .filter(([, { width }]) => width > 1)
    .sort(([, a], [, b]) => a.left - b.left);
  return shown.slice(1).flatMap(([each, { left }], at) =>
    left < shown[at][1].right - 1.5 ? [`${shown[at][0].className} covers ${each.className}`] : []);
}"""
_CONTENT_END = """(each) => each.getBoundingClientRect().bottom
  - parseFloat(getComputedStyle(each).paddingBottom)"""
_NOTIFY = """() => import("/static/app/shell/notice.js")
  .then(({ notify }) => notify("Desk saved. It is not in use."))"""
# The layout may still be settling.
_SETTLED_S = 4.0


def _comes_to_nothing(page: Page, measure: str, where: str, eventually: Eventually) -> None:
    eventually(
        lambda: (where, page.evaluate(measure)), _SETTLED_S, lambda answer: not any(answer[1])
    )


def _does_not_scroll(page: Page, where: str, eventually: Eventually) -> None:
    _comes_to_nothing(page, _OVERFLOW, where, eventually)
    expect(page.locator("#stop-robots")).to_be_in_viewport(ratio=1)
    expect(page.get_by_role("button", name="Menu")).to_be_in_viewport(ratio=1)


@pytest.mark.parametrize("size", _SIZES, ids=lambda size: f"{size['width']}")
def test_the_window_never_scrolls_and_stop_stays_visible(
    open_panel: OpenPanel, keep_picture: KeepPicture, size: ViewportSize, eventually: Eventually
) -> None:
    page = open_panel(viewport=size)
    for place in _PLACES:
        page.evaluate("(place) => { location.hash = place; }", place)
        page.wait_for_timeout(200)
        _does_not_scroll(page, place, eventually)
    keep_picture(page, f"shell-{size['width']}")
    page.get_by_role("tab", name="Calibration").click()
    page.locator("observer-calibration button", has_text="Calibrate").first.click()
    expect(page.locator("observer-calibration-wizard")).to_be_visible()
    _does_not_scroll(page, "wizard", eventually)
    keep_picture(page, f"shell-wizard-{size['width']}")


def test_run_methods_and_steps_pages_do_not_scroll_the_window(
    open_panel: OpenPanel, two_runs: list[str], eventually: Eventually
) -> None:
    page = open_panel()
    for place, ready in (
        (f"#runs/{two_runs[0]}", "observer-run-chart .uplot"),
        ("#methods", ".methods-conclusion"),
        ("#steps/6?source=simulated:lab&frame=40", ".step-picture img"),
    ):
        page.set_viewport_size(_SIZES[-1])
        page.evaluate("(place) => { location.hash = place; }", place)
        expect(page.locator(ready).first).to_be_visible(timeout=60_000)
        for size in _SIZES:
            page.set_viewport_size(size)
            page.wait_for_timeout(300)
            where = f"{place} at {size['width']}"
            _does_not_scroll(page, where, eventually)
            for measure in (TOO_WIDE, _MAIN_OVERFLOW):
                _comes_to_nothing(page, measure, where, eventually)


def test_other_pages_have_their_own_title_and_no_live_speed(
    open_panel: OpenPanel,
) -> None:
    page = open_panel()
    expect(page).to_have_title("Dynamic Observer")
    page.get_by_role("link", name="Runs", exact=True).click()
    expect(page).to_have_title(re.compile(r".* · Dynamic Observer"))
    expect(page.locator("observer-headline")).to_be_hidden()
    expect(page.get_by_role("link", name="Runs", exact=True)).to_have_attribute(
        "aria-current", "page"
    )
    compare = page.locator(".compare-methods")
    compare.click()
    expect(compare).to_have_attribute("aria-current", "page")
    expect(page.locator("observer-page-nav [aria-current]")).to_have_count(0)
    page.get_by_role("link", name="Live", exact=True).click()
    expect(page).to_have_title("Dynamic Observer")
    expect(page.locator("observer-headline")).to_be_visible()
    expect(compare).not_to_have_attribute("aria-current", "page")
    # The menu repeats no link that the header has room for.
    page.get_by_role("button", name="Menu").click()
    expect(page.locator("#page-menu").get_by_role("link")).to_have_text(["Help"])


def _width(page: Page) -> float:
    box = page.locator("#panel").bounding_box()
    assert box is not None
    return box["width"]


def test_panes_can_be_resized_and_closed_and_remember_it(
    open_panel: OpenPanel,
) -> None:
    page = open_panel()
    before = _width(page)
    bar = page.get_by_role("separator", name="Size of the side panel")
    bar.press("ArrowLeft")
    assert _width(page) > before + 10
    box = bar.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + 40
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x - 100, y, steps=4)
    page.mouse.up()
    dragged = _width(page)
    assert dragged > before + 90
    page.get_by_role("button", name="Close the speeds and obstacles").click()
    expect(page.locator("observer-speed-chart")).to_be_hidden()
    page.reload()
    page.wait_for_selector('html[data-freshness="fresh"]')
    assert abs(_width(page) - dragged) < 2
    expect(page.locator("observer-speed-chart")).to_be_hidden()
    page.get_by_role("button", name="Open the speeds and obstacles").click()
    expect(page.locator("observer-speed-chart")).to_be_visible()
    page.get_by_role("button", name="Close the side panel").click()
    expect(page.locator("#panel")).to_be_hidden()
    page.get_by_role("button", name="Open the side panel").click()
    expect(page.locator("#panel")).to_be_visible()
    # However far it is dragged, both sides stay usable.
    for _ in range(60):
        bar.press("ArrowRight")
    assert _width(page) > 150


def test_the_tour_completes_and_can_be_skipped(
    open_panel: OpenPanel, keep_picture: KeepPicture
) -> None:
    page = open_panel()
    page.get_by_role("button", name="Tour", exact=True).click()
    card = page.locator(".tour-card")
    expect(card).to_contain_text("What moves")
    card.get_by_role("button", name="Next").click()
    expect(page.locator("observer-scene")).to_have_attribute("data-toured", "")
    keep_picture(page, "tour")
    while (following := card.get_by_role("button", name="Next")).is_visible():
        following.click()
        expect(card).to_be_in_viewport(ratio=1)
    card.get_by_role("button", name="Done").click()
    expect(card).to_be_hidden()
    expect(page.locator("[data-toured]")).to_have_count(0)
    # It is offered once; later it is in the menu.
    page.reload()
    page.wait_for_selector('html[data-freshness="fresh"]')
    expect(page.get_by_role("button", name="Tour", exact=True)).to_be_hidden()
    page.evaluate("location.hash = '#runs'")
    expect(page.locator("observer-headline")).to_be_hidden()
    page.get_by_role("button", name="Menu").click()
    page.get_by_role("button", name="Take the tour").click()
    # It is about the live page, whichever was shown.
    expect(card).to_contain_text("What moves")
    page.keyboard.press("Escape")
    expect(card).to_be_hidden()
    expect(page.get_by_role("button", name="Menu")).to_be_focused()


def test_a_notice_does_not_cover_the_last_controls(open_panel: OpenPanel) -> None:
    page = open_panel(viewport={"width": 1024, "height": 460})
    page.get_by_role("tab", name="Calibration").click()
    page.locator("observer-calibration button", has_text="Calibrate").first.click()
    wizard = page.locator("observer-calibration-wizard")
    expect(wizard.get_by_role("heading", name="Calibrate: Board")).to_be_visible(timeout=20_000)
    page.evaluate(_NOTIFY)
    page.locator("main").evaluate("main => main.scrollTo(0, main.scrollHeight)")
    notice = page.get_by_text("Desk saved. It is not in use.").locator("..").bounding_box()
    assert notice is not None
    assert wizard.evaluate(_CONTENT_END) <= notice["y"]


def test_the_tour_shows_a_phone_every_part(open_panel: OpenPanel) -> None:
    page = open_panel(viewport=_SIZES[0], has_touch=True)
    page.get_by_role("tab", name="Parameters").click()
    page.get_by_role("button", name="Menu").click()
    page.get_by_role("button", name="Take the tour").click()
    card = page.locator(".tour-card")
    while (following := card.get_by_role("button", name="Next")).is_visible():
        expect(page.locator("[data-toured]")).to_be_in_viewport()
        following.click()
    expect(card).to_contain_text("8 of 8")


def test_a_phone_held_sideways_has_the_scene_beside_the_rest(open_panel: OpenPanel) -> None:
    page = open_panel(viewport={"width": 844, "height": 390}, has_touch=True)
    stage, image = page.locator(".stage"), page.locator("main .view-image").first
    before = stage.bounding_box()
    assert before is not None
    expect(image).to_be_in_viewport(ratio=0.9)
    page.locator("main").evaluate("main => main.scrollTo(0, 300)")
    # It stays while the rest is scrolled.
    assert stage.bounding_box() == before
    page.get_by_role("tab", name="Robots").click()
    expect(image).to_be_in_viewport(ratio=0.9)
    expect(page.locator("observer-robots")).to_be_in_viewport()


def test_an_operator_on_a_phone_sees_the_whole_left_view(open_panel: OpenPanel) -> None:
    page = open_panel(viewport=_SIZES[0], has_touch=True)
    page.locator("main").evaluate("main => main.scrollTo(0, main.scrollHeight)")
    page.get_by_role("tab", name="Robots").click()
    expect(page.locator("main .view-image").first).to_be_in_viewport(ratio=1)
    seen = page.locator("main").bounding_box()
    image = page.locator("main .view-image").first.bounding_box()
    assert seen is not None
    assert image is not None
    assert image["y"] >= seen["y"]
    # No part of a second one below it.
    expect(page.locator("main .view-image:visible")).to_have_count(1)


def test_a_phone_has_a_heading_and_a_home_link_visible_on_focus(
    open_panel: OpenPanel, eventually: Eventually
) -> None:
    page = open_panel(viewport=_SIZES[0])
    expect(page.get_by_role("heading", name="Dynamic Observer", level=1)).to_have_count(1)
    for _ in range(2):
        page.keyboard.press("Tab")
    link = page.get_by_role("link", name="Dynamic Observer")
    expect(link).to_be_focused()
    expect(link.locator("img")).to_be_in_viewport(ratio=1)
    _does_not_scroll(page, "focused", eventually)


def test_the_header_keeps_its_height_while_a_run_with_a_long_name_is_recorded(
    open_panel: OpenPanel, server: Server, keep_picture: KeepPicture, eventually: Eventually
) -> None:
    page = open_panel()
    run = server.api.post("/api/runs", json={"name": "Walk past the long shelf, evening"}).json()
    try:
        stop = page.get_by_role("button", name="Stop run")
        for size in _SIZES:
            page.set_viewport_size(size)
            expect(stop).to_be_in_viewport(ratio=1)
            _does_not_scroll(page, f"recording at {size['width']}", eventually)
            height = page.locator(".top").evaluate("top => top.clientHeight")
            assert height <= 60, f"{height} px at {size['width']}"
            assert page.evaluate(_HEADER_OVERLAPS) == [], size
        page.set_viewport_size(_SIZES[3])
        keep_picture(page, "shell-recording")
        stop.click()
        expect(page.get_by_text("stopped and saved")).to_be_visible()
        page.get_by_role("button", name="Open run").click()
        expect(page.locator("#page-title")).to_have_text("Walk past the long shelf, evening")
    finally:
        server.api.post(f"/api/runs/{run['id']}/stop")
