"""Choosing a source: the field with suggestions, tiles with pictures, a source's own board."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest
from playwright.sync_api import Error, Page, Route, expect

from .conftest import Eventually, KeepPicture, OpenPanel, Server

pytestmark = pytest.mark.usefixtures("lab_before_and_after")

_MARKED = "[role=option][aria-selected=true]"


def _newcomers_sources(page: Page) -> Page:
    """Show the picker as on a server on which only the lab was ever opened."""
    page.route("**/api/sources", _without_recent)
    page.reload()
    page.wait_for_selector('html[data-freshness="fresh"]', timeout=30_000)
    return _sources(page)


def _sources(page: Page) -> Page:
    page.get_by_role("tab", name="Source").click()
    expect(page.locator(".source[aria-current=true] b")).to_have_text("The lab")
    return page


def _is_file_of_tests(spec: str) -> bool:
    return "/pytest-of-" in spec


def _without_recent(route: Route) -> None:
    """Hide what other tests opened: their files, and the recent ranks of other sources."""
    try:
        answer = route.fetch()
    except Error:
        # The page was closed meanwhile.
        return
    entries = [entry for entry in answer.json() if not _is_file_of_tests(entry["spec"])]
    for entry in entries:
        entry["recent"] = 0 if entry["spec"] == "simulated:lab" else None
    entries.sort(key=lambda entry: entry["recent"] is None)
    route.fulfill(response=answer, json=entries)


def _spec(server: Server) -> str:
    return str(server.get("/status")["source"]["spec"])


def _show_all(page: Page) -> None:
    """Expand every group of tiles: sources opened by other tests may come first."""
    more = page.get_by_role("button", name=re.compile(r"Show all \d+"))
    while more.count():
        more.first.click()


def test_a_new_user_sees_the_beginner_scenarios_with_pictures(
    server: Server, open_panel: OpenPanel, keep_picture: KeepPicture
) -> None:
    page = _newcomers_sources(open_panel())
    titles = page.locator("#sources-simulated .source b")
    expect(titles).to_have_text(
        ["The lab", "People in the lab", "Driving by hand", "Two webcams and a chessboard"]
    )
    for title in ("The lab", "People in the lab", "Two webcams"):
        tile = page.locator(".source", has=page.get_by_text(title, exact=True))
        expect(tile).to_be_in_viewport()
    before = page.locator("#sources-simulated").bounding_box()
    # The server renders them once, when they are first viewed.
    page.wait_for_function(
        """() => [...document.querySelectorAll("#sources-simulated img")]
                 .every((image) => image.complete && image.naturalWidth === 256)""",
        timeout=60_000,
    )
    assert page.locator("#sources-simulated").bounding_box() == before
    keep_picture(page, "sources")

    more = page.get_by_role("button", name=re.compile(r"Show all \d+"))
    more.first.press("Enter")
    names = [
        entry["spec"]
        for entry in server.get("/sources")
        if entry["group"] == "simulated" and not _is_file_of_tests(entry["spec"])
    ]
    expect(titles).to_have_count(len(names))
    fewer = page.get_by_role("button", name="Show fewer")
    expect(fewer).to_be_focused()
    expect(fewer).to_have_attribute("aria-expanded", "true")
    fewer.press("Enter")
    expect(titles).to_have_count(4)


def test_the_open_source_always_has_a_tile(open_panel: OpenPanel) -> None:
    def others_first(route: Route) -> None:
        answer = route.fetch()
        entries = sorted(answer.json(), key=lambda entry: entry["spec"] == "simulated:lab")
        route.fulfill(response=answer, json=entries)

    page = open_panel()
    page.route("**/api/sources", others_first)
    page.reload()
    page.wait_for_selector('html[data-freshness="fresh"]', timeout=30_000)
    _sources(page)
    expect(page.locator("#sources-simulated .source")).to_have_count(4)


def test_suggestions_work_by_keyboard(
    server: Server, open_panel: OpenPanel, keep_picture: KeepPicture
) -> None:
    page = _sources(open_panel())
    field = page.get_by_role("combobox", name="Source", exact=True)
    options = page.get_by_role("listbox", name="Suggested sources").get_by_role("option")
    expect(field).to_have_attribute("aria-expanded", "false")
    field.focus()
    page.keyboard.press("ArrowDown")
    expect(field).to_have_attribute("aria-expanded", "true")
    # Recently opened sources come first.
    expect(options.first).to_contain_text("simulated:lab")
    expect(options.first).to_contain_text("Recent")
    expect(page.locator(_MARKED)).to_have_attribute("id", options.first.get_attribute("id"))
    expect(field).to_have_attribute("aria-activedescendant", options.first.get_attribute("id"))
    page.keyboard.press("Escape")
    expect(options.first).to_be_hidden()

    field.fill("people across")
    expect(options.first).to_contain_text("simulated:people_across")
    page.keyboard.press("ArrowDown")
    keep_picture(page, "sources-suggested")
    page.keyboard.press("Enter")
    expect(field).to_have_attribute("aria-expanded", "false")
    expect(page.locator(".notice")).to_contain_text("is open", timeout=15_000)
    assert _spec(server) == "simulated:people_across"
    expect(field).to_have_value("simulated:people_across")
    # From now on it is the first one.
    page.keyboard.press("ArrowDown")
    expect(options.first).to_contain_text("simulated:people_across")
    page.keyboard.press("Escape")

    # Any typed source can be opened, even without a suggestion.
    field.fill("simulated:lab?seed=2")
    page.keyboard.press("Enter")
    expect(field).to_have_value("simulated:lab?seed=2")
    page.wait_for_function("() => document.querySelector('.source[aria-busy]') === null")
    expect(page.locator(".notice").last).to_contain_text("seed=2", timeout=15_000)


def test_late_sources_are_suggested_for_the_typed_text(open_panel: OpenPanel) -> None:
    waiting: list[Route] = []

    def hold(route: Route) -> None:
        waiting.append(route)

    page = open_panel()
    page.route("**/api/sources", hold)
    page.get_by_role("tab", name="Source").click()
    field = page.get_by_role("combobox", name="Source", exact=True)
    options = page.get_by_role("listbox", name="Suggested sources").get_by_role("option")
    field.fill("people across")
    expect(field).to_have_attribute("aria-expanded", "false")
    for route in waiting:
        route.continue_()
    expect(options.first).to_contain_text("simulated:people_across")
    expect(field).to_have_attribute("aria-expanded", "true")

    # Suggestions come back after a text without matches.
    field.fill("no such source")
    expect(field).to_have_attribute("aria-expanded", "false")
    field.fill("people across")
    expect(field).to_have_attribute("aria-expanded", "true")


def test_suggestions_work_by_touch_and_templates_say_what_to_type(
    open_panel: OpenPanel, keep_picture: KeepPicture
) -> None:
    page = open_panel(viewport={"width": 360, "height": 780}, has_touch=True, is_mobile=True)
    page.get_by_role("tab", name="Source").tap()
    field = page.locator("#source-spec")
    field.tap()
    field.fill("network cameras")
    option = page.get_by_role("option", name=re.compile("Two network cameras"))
    expect(option).to_be_in_viewport()
    box = option.bounding_box()
    assert box is not None
    assert box["height"] >= 44
    keep_picture(page, "sources-phone")
    option.tap()
    expect(field).to_have_value("rtsp://LEFT,rtsp://RIGHT")
    expect(field).to_be_focused()
    selected = field.evaluate("(f) => f.value.slice(f.selectionStart, f.selectionEnd)")
    assert selected == "LEFT,rtsp://RIGHT"
    overflow = "document.documentElement.scrollWidth - innerWidth"
    assert page.evaluate(overflow) <= 0


def test_an_opening_error_is_shown_below_the_pressed_control(
    server: Server, open_panel: OpenPanel, eventually: Eventually
) -> None:
    page = _newcomers_sources(open_panel(refusals=True))
    refused = {"detail": [{"loc": ["body", "source"], "msg": "the robot has left the room"}]}
    waiting: list[Route] = []

    def refuse(route: Route) -> None:
        if route.request.method == "PUT":
            waiting.append(route)
        else:
            route.continue_()

    page.route("**/api/source", refuse)
    tile = page.locator('.source[data-spec="simulated:people"]')
    tile.click()
    # The tile says that it is being opened; nothing else can be pressed meanwhile.
    expect(tile).to_have_attribute("aria-busy", "true")
    expect(tile).to_contain_text("Opening…")
    expect(page.locator('.source[data-spec="simulated:drive"]')).to_have_attribute(
        "aria-disabled", "true"
    )
    height = tile.bounding_box()
    waiting[0].fulfill(status=422, json=refused)
    error = page.get_by_role("alert").filter(has_text="The robot has left the room.")
    expect(error).to_be_visible()
    assert error.evaluate("(e) => e.previousElementSibling.dataset.spec") == "simulated:people"
    assert tile.bounding_box() == height
    expect(tile).not_to_have_attribute("aria-busy", "true")
    expect(tile).to_be_focused()
    assert json.loads(waiting[0].request.post_data or "")["source"] == "simulated:people"
    assert _spec(server) == "simulated:lab"

    # Opening another one removes the error.
    page.unroute("**/api/source")
    tile.click()
    expect(error).to_be_hidden()
    eventually(lambda: _spec(server) == "simulated:people")
    expect(tile).to_have_attribute("aria-current", "true")


def test_a_run_is_found_by_name_and_played(
    server: Server, open_panel: OpenPanel, eventually: Eventually
) -> None:
    wanted = {"name": "Tuesday corridor", "source": "simulated:lab"}
    started = server.api.post("/api/runs", json=wanted)
    started.raise_for_status()
    run = started.json()["id"]
    try:
        eventually(lambda: server.get(f"/runs/{run}")["frames"] > 3, 40)
        server.api.post(f"/api/runs/{run}/stop").raise_for_status()
        page = open_panel()
        page.get_by_role("tab", name="Source").click()
        tile = page.locator("#sources-recordings .source").first
        expect(tile).to_contain_text("Tuesday corridor")
        page.wait_for_function(
            "() => document.querySelector('#sources-recordings img')?.naturalWidth > 0",
            timeout=30_000,
        )
        field = page.get_by_role("combobox", name="Source", exact=True)
        field.fill("tuesday")
        option = page.get_by_role("option", name=re.compile("Tuesday corridor"))
        option.click()
        eventually(lambda: server.get("/status")["source"]["kind"] == "recording", 20)
        expect(field).to_have_value(f"run:{run}")
        expect(tile).to_have_attribute("aria-current", "true")
        expect(page.locator("observer-source-picker")).to_contain_text(
            "Recording of Tuesday corridor"
        )
    finally:
        server.api.post(f"/api/runs/{run}/stop")
        server.api.put("/api/source", json={"source": "simulated:lab"}).raise_for_status()
        server.api.delete(f"/api/runs/{run}").raise_for_status()


def test_a_scenario_with_a_board_opens_the_wizard_with_that_board(
    server: Server, open_panel: OpenPanel, keep_picture: KeepPicture
) -> None:
    page = _sources(open_panel())
    board: Any = next(
        entry["board"]
        for entry in server.get("/sources")
        if entry["spec"] == "simulated:calibration"
    )
    # The user has printed another board before.
    page.get_by_role("tab", name="Calibration").click()
    page.get_by_role("button", name="Calibrate cameras").click()
    page.locator("#board-square").fill("30")
    page.get_by_role("button", name="Exit").click()

    page.get_by_role("tab", name="Source").click()
    _show_all(page)
    tile = page.locator('.source[data-spec="simulated:calibration"]')
    tile.click()
    expect(page.get_by_role("heading", name="Calibrate: Board")).to_be_focused()
    wizard = page.locator("observer-board-step")
    expect(page.locator("#board-source")).to_have_value("simulated:calibration")
    for field, key in (("kind", "kind"), ("columns", "columns"), ("rows", "rows")):
        expect(page.locator(f"#board-{field}")).to_have_value(str(board[key]))
    expect(page.locator("#board-square")).to_have_value(f"{board['square_mm']:g}")
    expect(wizard).to_contain_text(
        "simulated:calibration shows a board of its own: a chessboard with 9 × 6 inner corners and "
        "25 mm squares."
    )
    assert _spec(server) == "simulated:lab"

    page.locator("#board-square").fill("21")
    warning = page.get_by_text("measure 25 mm, not 21 mm. The baseline and all distances would be")
    expect(warning).to_contain_text("16 % too small")
    keep_picture(page, "wizard-other-board")
    page.get_by_role("button", name="Use the source's board").click()
    expect(warning).to_be_hidden()
    expect(page.locator("#board-square")).to_have_value("25")
    expect(page.locator("#board-square")).to_be_focused()

    page.get_by_role("button", name="Start with these cameras").click()
    expect(page.get_by_role("heading", name="Calibrate: Views")).to_be_focused(timeout=15_000)
    started = server.get("/status")["calibrating"]
    assert (started["source"], started["board"]["square_mm"]) == ("simulated:calibration", 25)
    server.api.delete("/api/calibrating").raise_for_status()

    # Other cameras bring back the printed board.
    page.get_by_role("tab", name="Calibration").click()
    page.get_by_role("button", name="Calibrate cameras").click()
    page.locator("#board-source").fill("camera:0,1")
    expect(page.locator("#board-square")).to_have_value("30")
    expect(wizard).not_to_contain_text("a board of its own")


def test_tiles_are_disabled_during_another_pages_run(server: Server, open_panel: OpenPanel) -> None:
    page = _sources(open_panel())
    run = server.api.post("/api/runs", json={"record": "none"}).json()["id"]
    try:
        _show_all(page)
        expect(page.locator('.source[data-spec="simulated:people"]')).to_be_disabled()
        expect(page.get_by_text("Stop the run to open another source.")).to_be_visible()
    finally:
        server.api.post(f"/api/runs/{run}/stop").raise_for_status()
        server.api.delete(f"/api/runs/{run}").raise_for_status()
    expect(page.locator('.source[data-spec="simulated:people"]')).to_be_enabled()
