"""Stopping the robots on the page: from anywhere, and for as long as the stop is latched."""

from __future__ import annotations

import time

import pytest
from playwright.sync_api import expect

from ..conftest import KeepPicture, Server
from ..witness import Witness, report
from .steps import Seat, arm, drive, open_run_options, press_pad

_ASK = """import("/static/app/shell/notice.js").then((notice) => {
  notice.askConfirmation("Are you sure?", "It is only a test.", "Do it");
})"""


def test_space_and_esc_stop_from_anywhere(
    room: Server, seat: Seat, keep_picture: KeepPicture
) -> None:
    page = seat()
    latched = page.locator(".stop-latched")

    def reset() -> None:
        expect(latched).to_contain_text("Stopped by")
        page.get_by_role("button", name="Reset").click()
        expect(latched).to_be_hidden()

    with Witness(room) as witness:
        for key in ("Space", "Escape"):
            drive(page, witness, lambda: press_pad(page), page.mouse.up)
            start = time.monotonic()
            page.keyboard.press(key)
            report(f"{key} pressed", witness.zero_after(start))
            page.mouse.up()
            if key == "Space":
                expect(latched).to_be_visible()
                keep_picture(page, "driving-stopped")
            reset()
            # Nothing starts by itself; once armed again, the key stops even from within a field.
            witness.stays_zero(0.2)
            arm(page)
            expect(page.locator(".stop-keys")).to_contain_text("always stop")
            open_run_options(page)
            page.locator("#run-name").focus()
            page.keyboard.press(key)
            reset()
            expect(page.locator("#run-name")).to_have_value("")
            arm(page)
    # Also over the wizard and a question, by their own buttons.
    page.get_by_role("tab", name="Calibration").click()
    page.locator("observer-calibration button", has_text="Calibrate").first.click()
    expect(page.locator("observer-calibration-wizard")).to_be_visible()
    expect(page.locator("#stop-robots")).to_be_in_viewport()
    page.evaluate(_ASK)
    page.locator("dialog").get_by_role("button", name="Stop robots").click()
    expect(latched).to_contain_text("Stopped by")
    page.locator("dialog").get_by_role("button", name="Cancel").click()


_HEADER_OVERLAPS = """() => {
  const parts = [...document.querySelectorAll(".header :is(a, button, label, .stop-state)")]
    .filter((part) => part.checkVisibility() && !part.closest(".menu-box"))
    .map((part) => [part.textContent.trim() || part.ariaLabel, part.getBoundingClientRect()]);
  return parts.flatMap(([name, a], at) =>
    parts
      .slice(at + 1)
      .filter(([, b]) => a.right - b.left > 2 && b.right - a.left > 2)
      .filter(([, b]) => a.bottom - b.top > 2 && b.bottom - a.top > 2)
      .map(([other]) => `${name} and ${other}`),
  );
}"""


def test_header_items_do_not_overlap_while_armed_or_stopped(
    seat: Seat,
) -> None:
    page = seat()
    found = {}
    for state in ("armed", "stopped"):
        if state == "stopped":
            page.locator("#stop-robots").click()
            expect(page.locator(".stop-state")).to_contain_text("Stopped by")
        for width in (360, 390, 600, 820, 960, 1024, 1100, 1280, 1366, 1440, 1600, 1920, 2560):
            page.set_viewport_size({"width": width, "height": 900})
            found[state, width] = page.evaluate(_HEADER_OVERLAPS)
    assert not any(found.values()), found


_HEADER_PLACES = """() => [...document.querySelectorAll(".top :is(a, button, label)")]
  .filter((part) => part.checkVisibility() && !part.closest(".menu-box"))
  .map((part) => {
    const { left, top, width, height } = part.getBoundingClientRect();
    return [part.textContent.trim() || part.ariaLabel, left, top, width, height].join();
  })"""


@pytest.mark.parametrize("width", [1440, 1280, 1024, 390])
def test_stopping_twice_in_a_row_stays_stopped_and_moves_nothing_in_the_header(
    seat: Seat, width: int
) -> None:
    page = seat()
    page.set_viewport_size({"width": width, "height": 900})
    before = page.evaluate(_HEADER_PLACES)
    stop = page.locator("#stop-robots").bounding_box()
    assert stop is not None
    at = (stop["x"] + stop["width"] / 2, stop["y"] + stop["height"] / 2)
    page.mouse.click(*at)
    expect(page.locator(".stop-state")).to_contain_text("Stopped by")
    reset = page.get_by_role("button", name="Reset", exact=True)
    expect(reset).to_be_disabled()
    assert page.evaluate(_HEADER_PLACES) == before
    page.mouse.click(*at)
    expect(reset).to_be_enabled(timeout=3_000)
    expect(page.locator(".stop-state")).to_contain_text("Stopped by")
    reset.click()
    expect(page.locator(".stop-latched")).to_be_hidden()
    # The hidden button does not take the keyboard's place with it.
    expect(page.locator("#stop-robots")).to_be_focused()
    assert page.evaluate(_HEADER_PLACES) == before


def test_esc_stops_while_armed_even_with_an_enlarged_view(seat: Seat) -> None:
    page = seat()
    view = page.locator('observer-live-view[data-view="left"]')
    view.get_by_role("button", name="Enlarge").click()
    page.keyboard.press("Escape")
    expect(page.locator(".stop-latched")).to_be_visible()
    expect(view).to_have_attribute("data-enlarged", "")
    # Nothing is armed any more.
    page.keyboard.press("Escape")
    expect(view).not_to_have_attribute("data-enlarged", "")


def test_keys_keep_their_usual_meaning_while_nothing_is_armed(seat: Seat) -> None:
    page = seat(armed=False)
    open_run_options(page)
    page.locator("#run-name").press("Space")
    expect(page.locator("#run-name")).to_have_value(" ")
    page.get_by_text("Port and model").focus()
    page.keyboard.press("Space")
    expect(page.locator("#robot-port")).to_be_visible()
    expect(page.locator(".stop-latched")).to_be_hidden()
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("Space")
    expect(page.locator(".stop-state")).to_contain_text("Stopped by")
