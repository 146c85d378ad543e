"""Parameters: a change reaches the engine, a bad value does not, and every step can be undone."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Locator, Page, expect

from .conftest import Eventually, KeepPicture, OpenPanel, Server

_NAME = "ego_motion.ransac_threshold_px"
_FIELD = "#parameter-ego_motion-ransac_threshold_px"


@pytest.fixture(autouse=True)
def _default_values(server: Server) -> Iterator[None]:
    """Each test starts from, and leaves, the values of the preset ``default``."""
    defaults = next(p["values"] for p in server.get("/presets") if p["name"] == "default")
    yield
    server.api.patch("/api/parameters", json=defaults).raise_for_status()
    for each in server.get("/presets"):
        if not each["built_in"]:
            server.api.delete(f"/api/presets/{each['name']}").raise_for_status()


@pytest.fixture
def form(open_panel: OpenPanel) -> Page:
    page = open_panel(refusals=True)
    page.get_by_role("tab", name="Parameters").click()
    expect(page.locator(_FIELD)).to_be_visible()
    return page


def test_a_change_applies_to_the_next_frames_and_can_be_undone(
    server: Server, form: Page, eventually: Eventually
) -> None:
    before = server.get("/parameters")
    form.locator(_FIELD).fill("3.2")
    form.keyboard.press("Enter")
    eventually(lambda: server.get("/parameters")["values"][_NAME] == 3.2)
    revision = server.get("/parameters")["revision"]
    assert revision > before["revision"]
    # The frame appears only once an observation carries the new revision.
    frame = eventually(
        lambda: (now := server.get("/parameters"))["revision"] == revision and now["frame"]
    )
    expect(form.locator(".revision")).to_have_text(f"In use since frame {frame}")
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
def test_a_bad_value_is_refused_with_a_reason_and_the_old_one_stays(
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


def test_a_slider_moves_by_keyboard_as_one_undo_step(
    server: Server, form: Page, eventually: Eventually
) -> None:
    slider = form.get_by_label("RANSAC threshold, slider")
    slider.focus()
    start = server.get("/parameters")["values"][_NAME]
    form.keyboard.press("ArrowRight")
    eventually(lambda: server.get("/parameters")["values"][_NAME] > start)
    form.keyboard.press("Control+z")
    eventually(lambda: server.get("/parameters")["values"][_NAME] == start)


def _field(form: Page, name: str) -> Locator:
    return form.locator(f'observer-parameter[data-name="{name}"]')


def _names(fields: Locator) -> list[str]:
    return fields.evaluate_all("fields => fields.map(({ dataset }) => dataset.name)")


@pytest.mark.parametrize("preset", ["default", "paper"])
def test_only_the_eight_basic_parameters_of_the_method_show_at_first(
    server: Server, form: Page, preset: str
) -> None:
    form.locator("#preset").select_option(preset)
    model = {"default": "rigid", "paper": "affine"}[preset]
    basic = [
        entry["name"]
        for entry in server.get("/parameters/schema")
        if entry.get("basic") and model in entry["models"]
    ]
    shown = form.locator("observer-parameter:visible")
    expect(form.locator(f'observer-parameter[data-name="{basic[2]}"]')).to_be_visible()
    expect(shown).to_have_count(8)
    assert _names(shown) == basic
    # All others are in their groups, each once.
    every = _names(form.locator("observer-parameters observer-parameter"))
    assert sorted(every) == sorted(entry["name"] for entry in server.get("/parameters/schema"))


def test_help_opens_by_keyboard_without_shifting_the_layout(server: Server, form: Page) -> None:
    field = _field(form, _NAME)
    before = field.bounding_box()
    opener = field.get_by_role("button", name="About RANSAC threshold")
    opener.focus()
    form.keyboard.press("Enter")
    box = form.locator(f"{_FIELD}-help")
    expect(box).to_be_visible()
    expect(box).to_contain_text("Maximum reprojection error of an inlier.")
    expect(box).to_contain_text("0.1 to 20 px. Default: 1.2 px.")
    assert field.bounding_box() == before
    seen = box.bounding_box()
    size = form.viewport_size
    assert seen["x"] >= 0
    assert seen["x"] + seen["width"] <= size["width"]
    assert seen["y"] + seen["height"] <= size["height"]
    form.keyboard.press("Escape")
    expect(box).to_be_hidden()
    # Elsewhere it stops the robots.
    assert server.get("/robots")["stopped"] is None
    expect(opener).to_be_focused()
    # Screen readers get the help without opening it.
    expect(form.locator(_FIELD)).to_have_accessible_description(re.compile("reprojection error"))


def test_changes_are_marked_and_resettable_on_field_group_and_tab(
    server: Server, form: Page, eventually: Eventually
) -> None:
    preset = server.get("/parameters")["values"]

    def changed() -> set[str]:
        values = server.get("/parameters")["values"]
        return {name for name in preset if values[name] != preset[name]}

    inliers, rows = "ego_motion.min_inliers", "klt_tracking.row_px"
    server.api.patch(
        "/api/parameters", json={_NAME: 3.0, inliers: 20, rows: 4.0}
    ).raise_for_status()
    tab = form.get_by_role("tab", name="Parameters 3 changed")
    expect(tab).to_be_visible()
    expect(_field(form, _NAME).locator(".changed-badge")).to_have_text("was 1.2")
    group = form.locator("details:not(.unused-groups)", has=_field(form, inliers))
    expect(group.locator("summary")).to_have_text(re.compile(r"Ego-motion\s*1 changed"))
    expect(form.locator(".basic-parameters .section-head")).to_contain_text("1 changed")

    _field(form, _NAME).get_by_role("button", name="Reset").click()
    eventually(lambda: changed() == {inliers, rows})
    group.locator("summary").click()
    group.get_by_role("button", name="Reset Ego-motion").click()
    eventually(lambda: changed() == {rows})
    form.get_by_role("button", name="Reset all").click()
    eventually(lambda: changed() == set())
    expect(form.get_by_role("tab", name="Parameters", exact=True)).to_be_visible()
    form.get_by_role("button", name="Undo").click()
    eventually(lambda: changed() == {rows})


def test_a_preset_is_saved_overwritten_and_deleted(
    server: Server, form: Page, eventually: Eventually
) -> None:
    def saved() -> dict[str, float]:
        own = [p for p in server.get("/presets") if not p["built_in"]]
        return {p["name"]: p["values"][_NAME] for p in own}

    def change(value: str) -> None:
        form.locator(_FIELD).fill(value)
        form.keyboard.press("Enter")
        eventually(lambda: server.get("/parameters")["values"][_NAME] == float(value))

    chooser = form.locator("#preset")
    change("2.5")
    expect(chooser).to_have_value("default")
    save_as = form.get_by_role("button", name="Save as…")
    save_as.click()
    form.locator("#preset-name").press("Escape")
    expect(form.locator("#preset-form")).to_be_hidden()
    expect(save_as).to_be_focused()
    save_as.click()
    form.locator("#preset-name").fill("paper")
    form.get_by_role("button", name="Save preset").click()
    expect(form.locator("#preset-error")).to_contain_text("built in; choose another name")
    form.locator("#preset-name").fill("mine")
    form.get_by_role("button", name="Save preset").click()
    eventually(lambda: saved() == {"mine": 2.5})
    expect(chooser).to_have_value("mine")
    # From now on differences are relative to this preset.
    expect(_field(form, _NAME).locator(".changed-badge")).to_be_hidden()
    change("4")
    expect(_field(form, _NAME).locator(".changed-badge")).to_have_text("was 2.5")
    form.get_by_role("button", name="Save", exact=True).click()
    form.get_by_role("button", name="Overwrite preset").click()
    eventually(lambda: saved() == {"mine": 4.0})
    change("5")
    chooser.select_option("default")
    notice = form.locator(".notice")
    expect(notice.last).to_contain_text("Preset default replaced 1 changed value of mine.")
    notice.last.get_by_role("button", name="Undo").click()
    eventually(lambda: server.get("/parameters")["values"][_NAME] == 5.0)
    expect(chooser).to_have_value("mine")
    form.get_by_role("button", name="More", exact=True).click()
    form.get_by_role("button", name="Delete preset…").click()
    form.get_by_role("button", name="Delete preset", exact=True).click()
    eventually(lambda: saved() == {})
    expect(chooser).to_have_value("default")
    assert server.get("/parameters")["values"][_NAME] == 5.0


def test_a_preset_is_shared_as_a_file_and_a_bad_file_is_refused_by_name(
    server: Server, form: Page, eventually: Eventually, tmp_path: Path
) -> None:
    form.locator(_FIELD).fill("2.5")
    form.keyboard.press("Enter")
    expect(form.get_by_role("tab", name="Parameters 1 changed")).to_be_visible()
    more = form.get_by_role("button", name="More", exact=True)
    more.click()
    with form.expect_download() as download:
        form.get_by_role("button", name="Download file").click()
    assert download.value.suggested_filename == "default-changed.preset.json"
    file = json.loads(Path(download.value.path()).read_text())
    assert file["values"][_NAME] == 2.5

    def take(content: object, name: str) -> None:
        path = tmp_path / name
        path.write_text(content if isinstance(content, str) else json.dumps(content))
        more.click()
        with form.expect_file_chooser() as chooser:
            form.get_by_role("button", name="Import file…").click()
        chooser.value.set_files(path)

    error = form.locator("#preset-error")
    take("{", "broken.json")
    expect(error).to_have_text("broken.json is not a preset: it is not JSON.")
    take({**file, "values": {_NAME: 99}}, "far.json")
    expect(error).to_have_text(
        f"far.json was not imported: {_NAME}: must be a finite number from 0.1 to 20 px."
    )
    before = server.get("/parameters")
    take({**file, "name": "paper", "values": {**file["values"], _NAME: 2.7}}, "theirs.json")
    notice = form.locator(".notice").last
    expect(notice).to_contain_text("Imported as preset paper 2, because a preset paper")
    expect(error).to_have_text("")
    assert server.get("/parameters") == before
    form.locator("#preset").select_option("paper 2")
    eventually(lambda: server.get("/parameters")["based_on"] == "paper 2")
    assert server.get("/parameters")["values"][_NAME] == 2.7


def test_presets_are_compared(form: Page, keep_picture: KeepPicture) -> None:
    form.get_by_role("button", name="Compare…").click()
    dialog = form.get_by_role("dialog", name="Compare presets")
    row = dialog.get_by_role("row", name=re.compile("^Method "))
    expect(row).to_contain_text("Rigid")
    expect(row).to_contain_text("Affine")
    expect(dialog.get_by_role("status")).to_have_text("9 values differ.")
    keep_picture(form, "presets-compared")
    dialog.get_by_label("Second").select_option("Current values")
    expect(dialog.get_by_role("status")).to_have_text("All values are the same.")
    dialog.get_by_role("button", name="Close").click()
    expect(dialog).to_be_hidden()


def test_switching_the_method_in_the_header_restores_its_changes(
    server: Server, form: Page, eventually: Eventually
) -> None:
    switch = form.locator("observer-method-switch")
    default, paper = (switch.get_by_role("radio", name=name) for name in ("default", "paper"))
    expect(default).to_be_checked()
    guard = "guard.margin_m"
    server.api.patch("/api/parameters", json={_NAME: 3.0, guard: 0.3}).raise_for_status()
    expect(default.locator("..").locator(".changed-dot")).to_be_visible()
    paper.check(force=True)
    eventually(lambda: server.get("/parameters")["based_on"] == "paper")
    values = server.get("/parameters")["values"]
    # As published, except the parameters that keep robots from hitting anything.
    published = next(p["values"] for p in server.get("/presets") if p["name"] == "paper")
    assert {n for n in values if values[n] != published[n]} == {guard}
    assert values[guard] == 0.3
    notice = form.locator(".notice").last
    told = "Switched to paper. Kept for when you switch back: 1 change to default."
    expect(notice).to_contain_text(told)
    # It is a single undo step.
    notice.get_by_role("button", name="Undo").click()
    eventually(lambda: server.get("/parameters")["values"]["ego_motion.model"] == "rigid")
    assert server.get("/parameters")["values"][_NAME] == 3.0
    expect(default).to_be_checked()
    paper.check(force=True)
    eventually(lambda: server.get("/parameters")["based_on"] == "paper")
    form.reload()
    expect(paper).to_be_checked()
    default.check(force=True)
    eventually(lambda: server.get("/parameters")["based_on"] == "default")
    assert server.get("/parameters")["values"][_NAME] == 3.0
    told = "Switched to default, as you left it: 1 value differs from default."
    expect(form.locator(".notice").last).to_contain_text(told)
    assert switch.get_by_role("link", name="Compare").get_attribute("href") == "#methods"


def test_a_preset_is_selected_and_parameters_are_searched(
    server: Server, form: Page, eventually: Eventually
) -> None:
    form.locator("#preset").select_option("paper")
    eventually(lambda: server.get("/parameters")["preset"] == "paper")
    form.locator("#parameter-search").fill("residual")
    shown = form.locator("observer-parameter:visible")
    expect(shown.first).to_be_visible()
    assert 0 < shown.count() < form.locator("observer-parameter").count()
    form.locator("#parameter-search").fill("")
    # Groups opened to show matches are closed again.
    expect(shown).to_have_count(8)
    form.get_by_role("button", name="Undo").click()
    eventually(lambda: server.get("/parameters")["preset"] == "default")


def test_the_detector_is_applied_and_unused_parameters_say_so(
    server: Server, form: Page, eventually: Eventually
) -> None:
    def of(name: str) -> Locator:
        return form.locator(f'observer-parameter[data-name="features.{name}"]')

    form.locator("details", has=of("max_count")).locator("summary").click()
    expect(of("max_count").locator(".idle")).to_have_text("Not used by the rigid method.")
    expect(of("detector").locator(".idle")).to_be_hidden()
    form.locator("#parameter-features-detector").select_option("fast")
    in_force = re.compile(r"In use since frame \d+")
    expect(form.locator(".revision")).to_have_text(in_force, timeout=10_000)
    eventually(lambda: server.get("/parameters")["values"]["features.detector"] == "fast")
