"""The paper's method step by step: pictures, parameters, addresses, presenting."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import Page, Route, expect

from .conftest import KeepPicture, OpenPanel

# A low-priority process computes and draws; the first time it has to start.
_MADE_MS = 60_000
_THRESHOLD = "flow.residual_threshold_px"
_PHONE = {"width": 390, "height": 844}


def _seen(page: Page) -> None:
    """Wait until the picture of the current step is loaded."""
    picture = page.locator("observer-steps .step-picture")
    expect(picture.locator("img")).to_be_visible(timeout=_MADE_MS)
    expect(picture).not_to_have_attribute("aria-busy", "true", timeout=_MADE_MS)
    expect(page.locator("observer-steps")).not_to_have_attribute(
        "aria-busy", "true", timeout=_MADE_MS
    )
    size = picture.locator("img").evaluate("(e) => [e.naturalWidth, e.naturalHeight]")
    assert min(size) > 100


def _go(page: Page, hash: str) -> None:
    page.evaluate("(hash) => { location.hash = hash; }", hash)


def test_a_step_has_no_empty_headings_before_its_answer(open_panel: OpenPanel) -> None:
    page = open_panel()
    held: list[Route] = []

    def keep(route: Route) -> None:
        held.append(route)

    page.route("**/api/steps?*", keep)
    _go(page, "#steps/6?source=simulated:lab&frame=40")
    numbers = page.get_by_role("heading", name="Numbers")
    expect(page.locator(".steps-strip")).to_be_visible()
    expect(numbers).to_be_hidden()
    expect(page.locator(".step-formula")).to_be_hidden()
    page.unroute("**/api/steps?*")
    for route in held:
        route.continue_()
    expect(numbers).to_be_visible(timeout=_MADE_MS)
    expect(page.locator(".step-formula")).to_be_visible()


def test_keys_navigate_the_nine_steps_and_update_the_url(
    open_panel: OpenPanel, keep_picture: KeepPicture
) -> None:
    page = open_panel()
    _go(page, "#steps")
    _seen(page)
    expect(page).to_have_title(re.compile("step by step"))
    current = page.locator(".steps-strip [aria-current=step]")
    expect(current).to_have_text(re.compile("^1"))
    assert re.search(r"#steps/1\?source=simulated:lab&frame=\d+&preset=paper$", page.url)
    page.keyboard.press("ArrowRight")
    expect(current).to_have_text(re.compile("^2"))
    page.keyboard.press("4")
    expect(page.locator("observer-steps h3").first).to_have_text(re.compile("RANSAC"))
    _seen(page)
    keep_picture(page, "steps-4")
    expect(page.locator(".step-formula mtable").first).to_be_visible()
    expect(page.locator(".step-numbers")).to_contain_text("Inliers")
    page.go_back()
    expect(current).to_have_text(re.compile("^2"))
    page.go_forward()
    expect(current).to_have_text(re.compile("^4"))
    page.get_by_role("button", name="9 Obstacles").click()
    _seen(page)
    expect(page.locator(".step-numbers")).to_contain_text("true speed")
    keep_picture(page, "steps-9")
    page.reload()
    expect(current).to_have_text(re.compile("^9"))
    _seen(page)
    page.keyboard.press("ArrowRight")
    expect(current).to_have_text(re.compile("^9"))
    page.get_by_role("button", name="Back to live").click()
    expect(page.locator("observer-steps")).to_be_hidden()


def test_a_page_waiting_for_its_first_response_says_so(open_panel: OpenPanel) -> None:
    waiting: list[Route] = []

    def hold(route: Route) -> None:
        waiting.append(route)

    page = open_panel()
    expect(page.locator(".beside-runs")).to_be_hidden()
    page.route("**/api/steps?*", hold)
    _go(page, "#steps")
    steps = page.locator("observer-steps")
    expect(steps.get_by_text("Processing the frames…")).to_be_visible()
    expect(steps.get_by_text("This step has no parameters.")).to_be_hidden()
    expect(page.locator(".beside-runs")).to_contain_text("apply to the live source")
    for route in waiting:
        route.continue_()
    _seen(page)
    expect(steps.get_by_text("Processing the frames…")).to_be_hidden()


def test_a_late_response_does_not_change_the_url_of_another_page(open_panel: OpenPanel) -> None:
    """An answer may arrive after the address has changed but before the page is told."""
    waiting: list[Route] = []

    def hold(route: Route) -> None:
        waiting.append(route)

    page = open_panel()
    _go(page, "#steps/2?source=simulated:lab&frame=40")
    _seen(page)
    page.route("**/api/steps?*", hold)
    _go(page, "#steps/2?source=simulated:lab&frame=41")
    expect(page.locator("observer-steps")).to_have_attribute("aria-busy", "true")
    left = page.evaluate(
        """() => {
            history.pushState(null, "", location.hash.replace("steps/2", "steps/7"));
            return location.hash;
        }"""
    )
    page.unroute("**/api/steps?*")
    for route in waiting:
        route.continue_()
    _seen(page)
    assert page.evaluate("location.hash") == left


def test_a_parameter_changes_picture_and_numbers_but_nothing_live(
    open_panel: OpenPanel, keep_picture: KeepPicture
) -> None:
    page = open_panel(refusals=True)
    _go(page, "#steps/6?source=simulated:lab&frame=40")
    _seen(page)
    dynamic = page.locator(".step-numbers tr", has_text=re.compile("^Dynamic"))
    before = int(dynamic.locator("td").inner_text())
    image = page.locator(".step-picture img")
    src = image.get_attribute("src")
    field = page.locator(f'.step-parameters [data-name="{_THRESHOLD}"]')
    slider = field.locator("input[type=range]")
    slider.focus()
    for _ in range(12):
        page.keyboard.press("ArrowRight")
    expect(dynamic.locator("td")).not_to_have_text(str(before), timeout=_MADE_MS)
    expect(image).not_to_have_attribute("src", src or "", timeout=_MADE_MS)
    _seen(page)
    assert int(dynamic.locator("td").inner_text()) < before
    assert f"p.{_THRESHOLD}=" in page.url
    expect(field.locator(".changed-badge")).to_be_visible()
    keep_picture(page, "steps-6")
    # A refusal is shown at the field, and everything else stays.
    src = image.get_attribute("src")
    number = field.locator("input[type=number]")
    number.fill("900")
    number.press("Enter")
    expect(field.locator(".field-error")).to_contain_text("0.1 to 30", timeout=_MADE_MS)
    assert image.get_attribute("src") == src
    assert "900" not in page.url
    assert page.evaluate("fetch('/api/parameters').then(a => a.json()).then(a => a.preset)") == (
        "default"
    )
    frame = page.locator("#steps-frame")
    frame.fill("99999")
    frame.press("Enter")
    expect(page.locator("#steps-error")).to_contain_text("frames are 0 to", timeout=_MADE_MS)
    frame.fill("30")
    frame.press("Enter")
    expect(page.locator("#steps-error")).to_be_empty(timeout=_MADE_MS)
    _seen(page)
    assert "frame=30" in page.url


def test_a_step_is_exported(open_panel: OpenPanel, keep_picture: KeepPicture) -> None:
    page = open_panel()
    _go(page, "#steps/4?source=simulated:lab&frame=40")
    _seen(page)
    for name, start in (("PNG", b"\x89PNG"), ("PDF", b"%PDF"), ("CSV", b"u_t_px")):
        page.locator("observer-steps").get_by_role("button", name="Export").click()
        expect(page.get_by_role("menuitem", name="PDF")).to_be_visible()
        keep_picture(page, "steps-export")
        with page.expect_download(timeout=_MADE_MS) as saved:
            page.get_by_role("menuitem", name=re.compile(name)).click()
        assert saved.value.suggested_filename.startswith("step-4-ego_motion-frame-40.")
        assert saved.value.path().read_bytes().startswith(start)


def test_a_step_is_presented_until_escape(open_panel: OpenPanel, keep_picture: KeepPicture) -> None:
    page = open_panel()
    _go(page, "#steps/6?source=simulated:lab&frame=40")
    _seen(page)
    page.keyboard.press("p")
    dialog = page.locator("dialog.presentation")
    expect(dialog).to_be_visible()
    expect(dialog.locator("img")).to_have_attribute("src", re.compile("blob"))
    page.wait_for_timeout(500)
    keep_picture(page, "steps-presented")
    page.keyboard.press("ArrowRight")
    expect(dialog.locator("h2")).to_have_text(re.compile("Stereo"))
    expect(dialog).to_contain_text("7 / 9")
    expect(dialog.get_by_role("button", name="Stop robots")).to_be_hidden()
    page.keyboard.press("Escape")
    expect(dialog).to_be_hidden()
    expect(page.locator(".steps-strip [aria-current=step]")).to_have_text(re.compile("^7"))


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_steps_fit_a_phone(open_panel: OpenPanel, keep_picture: KeepPicture, scheme: str) -> None:
    page = open_panel(viewport=_PHONE, color_scheme=scheme)
    _go(page, "#steps/7?source=simulated:lab&frame=40")
    _seen(page)
    assert page.evaluate("document.documentElement.scrollWidth") == _PHONE["width"]
    main = page.locator("main").evaluate("(e) => [e.scrollWidth, e.clientWidth]")
    assert main[0] <= main[1]
    keep_picture(page, f"steps-phone-{scheme}")
    if scheme == "dark":
        page.set_viewport_size({"width": 1440, "height": 900})
        keep_picture(page, "steps-dark")
