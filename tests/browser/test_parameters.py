"""Parameters: a change reaches the engine, a bad value does not, and every step has a way back."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Locator, Page, expect

from .conftest import Eventually, OpenPanel, Server

_NAME = "ego_motion.ransac_threshold_px"
_FIELD = "#parameter-ego_motion-ransac_threshold_px"


@pytest.fixture(autouse=True)
def _default_values(server: Server) -> Iterator[None]:
    """Each test starts from, and leaves, the values of the preset ``default``."""
    defaults = next(p["values"] for p in server.get("/presets") if p["name"] == "default")
    yield
    server.api.patch("/api/parameters", json=defaults).raise_for_status()


@pytest.fixture
def form(open_panel: OpenPanel) -> Page:
    page = open_panel(refusals=True)
    page.get_by_role("tab", name="Parameters").click()
    expect(page.locator(_FIELD)).to_be_visible()
    return page


def test_a_change_acts_on_the_next_frames_and_can_be_undone(
    server: Server, form: Page, eventually: Eventually
) -> None:
    before = server.get("/parameters")
    form.locator(_FIELD).fill("3.2")
    form.keyboard.press("Enter")
    eventually(lambda: server.get("/parameters")["values"][_NAME] == 3.2)
    revision = server.get("/parameters")["revision"]
    assert revision > before["revision"]
    # "Applied" is said only once an observation carries the new revision.
    frame = eventually(
        lambda: (now := server.get("/parameters"))["revision"] == revision and now["frame"]
    )
    expect(form.locator(".revision")).to_have_text(f"Applied at frame {frame}")
    field = form.locator(f'observer-parameter[data-name="{_NAME}"]')
    expect(field).to_have_attribute("data-changed", "")

    form.locator(_FIELD).focus()
    form.keyboard.press("Control+z")
    eventually(lambda: server.get("/parameters")["values"] == before["values"])
    expect(form.locator(_FIELD)).to_have_value(f"{before['values'][_NAME]:g}")
    form.get_by_role("button", name="Redo").click()
    eventually(lambda: server.get("/parameters")["values"][_NAME] == 3.2)
    field.get_by_role("button", name="Reset").click()
    eventually(lambda: server.get("/parameters")["values"] == before["values"])
    expect(field).not_to_have_attribute("data-changed", "")


@pytest.mark.parametrize("typed", ["99", "-1", ""])
def test_a_bad_value_is_refused_in_words_and_the_old_one_stays(
    server: Server, form: Page, typed: str
) -> None:
    before = server.get("/parameters")
    old = form.locator(_FIELD).input_value()
    form.locator(_FIELD).fill(typed)
    form.keyboard.press("Enter")
    error = form.locator(f"{_FIELD}-error")
    expect(error).to_contain_text("must be a finite number from 0.1 to 20 px")
    expect(error).to_contain_text(f"stays at {old}")
    expect(form.locator(_FIELD)).to_have_value(old)
    expect(form.locator(_FIELD)).to_have_attribute("aria-invalid", "true")
    assert server.get("/parameters") == before


def test_a_slider_moves_by_keyboard_and_is_one_step_of_undo(
    server: Server, form: Page, eventually: Eventually
) -> None:
    slider = form.get_by_label("RANSAC threshold, slider")
    slider.focus()
    start = server.get("/parameters")["values"][_NAME]
    form.keyboard.press("ArrowRight")
    eventually(lambda: server.get("/parameters")["values"][_NAME] > start)
    form.keyboard.press("Control+z")
    eventually(lambda: server.get("/parameters")["values"][_NAME] == start)


def test_presets_and_search(server: Server, form: Page, eventually: Eventually) -> None:
    form.get_by_label("Preset", exact=True).select_option("paper")
    eventually(lambda: server.get("/parameters")["preset"] == "paper")
    form.locator("#preset-name").fill("mine")
    form.get_by_role("button", name="Save preset").click()
    eventually(lambda: "mine" in [p["name"] for p in server.get("/presets")])
    server.api.delete("/api/presets/mine").raise_for_status()
    form.locator("#parameter-search").fill("residual")
    shown = form.locator("observer-parameter:visible")
    expect(shown.first).to_be_visible()
    assert 0 < shown.count() < form.locator("observer-parameter").count()
    form.get_by_role("button", name="Undo").click()
    eventually(lambda: server.get("/parameters")["preset"] == "default")


def test_the_detector_acts_in_space_and_what_does_not_says_so(
    server: Server, form: Page, eventually: Eventually
) -> None:
    def of(name: str) -> Locator:
        return form.locator(f'observer-parameter[data-name="features.{name}"]')

    form.locator("details", has=of("detector")).locator("summary").click()
    expect(of("max_count")).to_contain_text("Not used by the rigid model.")
    expect(of("detector")).not_to_contain_text("Not used by the rigid model.")
    form.locator("#parameter-features-detector").select_option("fast")
    in_force = re.compile(r"Applied at frame \d+")
    expect(form.locator(".revision")).to_have_text(in_force, timeout=10_000)
    eventually(lambda: server.get("/parameters")["values"]["features.detector"] == "fast")
