"""The page's form: phones, colours, keyboard, names and contrast."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from playwright.sync_api import Browser, Page, expect

from .conftest import TOO_WIDE, KeepPicture, OpenPanel, Server

_TABS = ("Source", "Parameters", "Robots", "Calibration", "Runs", "Status")
# More than any view of the page has.
_MOST_STOPS = 250

# Texts whose contrast to their background is below WCAG AA.
_FAINT = """() => {
  const canvas = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
  const rgba = (colour) => {
    canvas.clearRect(0, 0, 1, 1);
    canvas.fillStyle = colour;
    canvas.fillRect(0, 0, 1, 1);
    return [...canvas.getImageData(0, 0, 1, 1).data];
  };
  const light = ([r, g, b]) => [r, g, b]
    .map((v) => (v /= 255) <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
  const ground = (element) => {
    for (let e = element; e; e = e.parentElement) {
      const colour = rgba(getComputedStyle(e).backgroundColor);
      if (colour[3] > 250) return colour;
    }
    return [255, 255, 255, 255];
  };
  const faint = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const e = walker.currentNode.parentElement;
    if (!walker.currentNode.data.trim()) continue;
    if (!e.checkVisibility({ visibilityProperty: true })) continue;
    if (e.closest("button:disabled, .visually-hidden, option, script, noscript")) continue;
    const style = getComputedStyle(e);
    const [a, b] = [light(rgba(style.color)), light(ground(e))].sort((x, y) => y - x);
    const ratio = (a + 0.05) / (b + 0.05);
    const large = parseFloat(style.fontSize) >= 24
      || (parseFloat(style.fontSize) >= 18.66 && style.fontWeight >= 600);
    if (ratio < (large ? 3 : 4.5)) faint.push(`${ratio.toFixed(2)}: ${e.outerHTML.slice(0, 120)}`);
  }
  return faint;
}"""

_NAMELESS = """() => [...document.querySelectorAll(
    "button, input, select, a, canvas, iframe, meter, progress")]
  .filter((e) => e.checkVisibility() && !e.closest(".uplot"))
  .filter((e) => !e.getAttribute("aria-label") && !e.title)
  .filter((e) => !e.labels?.length && !e.textContent.trim())
  .map((e) => e.outerHTML.slice(0, 160))"""

_FOCUSED = """() => {
  const e = document.activeElement;
  if (!e.dataset.reached) e.dataset.reached = "yes";
  const shown = e.type === "checkbox" || e.type === "radio" ? [e, e.closest("label")] : [e];
  const outlined = shown.some((s) => s && getComputedStyle(s).outlineStyle !== "none");
  return [e.outerHTML.slice(0, 120), e === document.body || e.tagName === "IFRAME" || outlined];
}"""

_UNREACHED = """() => [...document.querySelectorAll(
    "button, input, select, textarea, a, summary, [tabindex='0']")]
  .filter((e) => e.checkVisibility() && !e.disabled && e.tabIndex >= 0 && !e.dataset.reached)
  .filter((e) => e.type !== "radio" || e.checked)
  .map((e) => e.outerHTML.slice(0, 160))"""


def test_a_phone_shows_everything_without_scrolling_sideways(
    open_panel: OpenPanel, keep_picture: KeepPicture, wait_for_scene: Callable[[Page], None]
) -> None:
    page = open_panel(viewer=True, viewport={"width": 360, "height": 780}, has_touch=True)
    wait_for_scene(page)
    keep_picture(page, "phone")
    # It has been checked; the rest runs faster without it.
    page.evaluate("document.querySelector('observer-scene iframe').remove()")
    for name in ("warped", "disparity"):
        page.locator(f"input[name=view][value={name}]").check()
    for tab in ("View", *_TABS):
        page.get_by_role("tab", name=tab).click()
        page.wait_for_timeout(150)
        assert page.evaluate("document.documentElement.scrollWidth") <= 360, tab
        assert page.evaluate(TOO_WIDE) == [], tab
        # The stop button and the tabs never scroll away: the window does not scroll at all.
        assert page.evaluate("document.documentElement.scrollHeight") <= 780, tab
        expect(page.locator("#stop-robots")).to_be_in_viewport()
        expect(page.get_by_role("tab", name="View")).to_be_in_viewport()
    page.get_by_role("tab", name="Parameters").click()
    keep_picture(page, "phone-parameters")
    # While driving, the user sees where to.
    page.get_by_role("tab", name="Robots").click()
    expect(page.locator("observer-live-view canvas").first).to_be_in_viewport()
    page.get_by_role("tab", name="View").click()
    expect(page.locator("observer-scene")).to_be_in_viewport()


def _darkness(page: Page) -> float:
    """Return 0 for a white background, 1 for a black one."""
    colour = page.evaluate("getComputedStyle(document.querySelector('#panel')).backgroundColor")
    channels = [float(part) for part in colour.strip("rgba()").split(",")[:3]]
    return 1 - sum(channels) / 765


def test_colours_follow_the_system_or_the_saved_choice(open_panel: OpenPanel) -> None:
    page = open_panel(color_scheme="dark")
    assert _darkness(page) > 0.85
    page.get_by_role("button", name="Menu").click()
    page.locator("input[name=theme][value=light]").check()
    assert _darkness(page) < 0.1
    page.reload()
    page.wait_for_selector("input[name=theme][value=light]:checked", state="attached")
    assert _darkness(page) < 0.1
    page.get_by_role("button", name="Menu").click()
    page.locator("input[name=theme][value=auto]").check()
    assert _darkness(page) > 0.85


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_every_text_has_contrast_and_every_control_a_name(
    open_panel: OpenPanel, scheme: str
) -> None:
    page = open_panel(color_scheme=scheme)
    for tab in _TABS:
        page.get_by_role("tab", name=tab).click()
        page.wait_for_timeout(150)
        assert page.evaluate(_FAINT) == [], tab
        assert page.evaluate(_NAMELESS) == [], tab


def test_everything_is_reachable_by_keyboard_with_visible_focus(open_panel: OpenPanel) -> None:
    page = open_panel()
    page.get_by_role("tab", name="Source").focus()
    page.keyboard.press("ArrowRight")
    expect(page.get_by_role("tab", name="Parameters")).to_be_focused()
    expect(page.locator("#pane-parameters")).to_be_visible()
    _go_around(page, "live")


def test_run_pages_and_the_wizard_work_by_keyboard(
    open_panel: OpenPanel, two_runs: list[str]
) -> None:
    page = open_panel()
    for place, ready in (
        ("#runs", ".run-rows li"),
        (f"#runs/{two_runs[0]}", "observer-run-chart .uplot"),
        ("#methods", ".methods-conclusion"),
        ("#steps/6?source=simulated:lab&frame=40", ".step-numbers tr"),
    ):
        page.evaluate("(place) => { location.hash = place; }", place)
        expect(page.locator(ready).first).to_be_visible(timeout=60_000)
        _go_around(page, place)
    page.evaluate("location.hash = '#live'")
    page.get_by_role("tab", name="Calibration").click()
    page.locator("observer-calibration button", has_text="Calibrate").first.click()
    expect(page.get_by_role("heading", name="Calibrate: Board")).to_be_visible()
    _go_around(page, "wizard")


def _go_around(page: Page, where: str) -> None:
    """Press Tab from the first control until it returns there: each is reached and visible."""
    page.evaluate("for (const e of document.querySelectorAll('*')) delete e.dataset?.reached")
    page.locator(".skip-link").focus()
    reached = page.evaluate(_FOCUSED)[0]
    for _ in range(_MOST_STOPS):
        page.keyboard.press("Tab")
        reached, visible = page.evaluate(_FOCUSED)
        assert visible, f"{where}: focus is not seen: {reached}"
        if "skip-link" in reached:
            break
    else:
        pytest.fail(f"{where}: Tab does not come around, but stays about {reached}")
    assert page.evaluate(_UNREACHED) == [], where


def test_a_user_signs_in_by_typing_the_token(server: Server, browser: Browser) -> None:
    """A user without the link is asked for the token and told where to find it."""
    context = browser.new_context()
    page = context.new_page()
    address, _, token = server.link.partition("?token=")
    try:
        page.goto(address)
        expect(page.get_by_text("Open the link that the server printed")).to_be_visible()
        page.get_by_label("Token").fill("wrong")
        page.get_by_role("button", name="Sign in").click()
        expect(page.get_by_label("Token")).to_be_visible()
        page.get_by_label("Token").fill(token)
        page.get_by_role("button", name="Sign in").click()
        expect(page.locator("observer-headline")).to_be_visible()
        assert "token" not in page.url
    finally:
        context.close()
