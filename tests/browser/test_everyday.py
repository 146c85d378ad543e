"""Sharing a link, watching by one, the list of keys and the log, as a person uses them."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
from playwright.sync_api import Browser, Page, Route, ViewportSize, expect

from app.http.gate.token import read_only_token

from .conftest import KeepPicture, OpenPanel, Server

PHONE: ViewportSize = {"width": 390, "height": 844}
WATCHING_ONLY = "This link is for watching. Ask for an operator link to change anything."


@pytest.fixture
def watching(
    server: Server, browser: Browser, leave_viewer_out: Callable[[Page], None]
) -> Iterator[Page]:
    """The page as somebody sees it who came by a read-only link."""
    context = browser.new_context()
    page = context.new_page()
    leave_viewer_out(page)
    address, _, token = server.link.partition("?token=")
    page.goto(f"{address}?token={read_only_token(token)}")
    page.wait_for_selector('html[data-freshness="fresh"]', timeout=30_000)
    yield page
    context.close()


def from_menu(page: Page, name: str) -> None:
    page.get_by_role("button", name="Menu").click()
    page.locator("#page-menu").get_by_role("button", name=name).click()


@pytest.mark.parametrize("size", [None, PHONE], ids=["desktop", "phone"])
def test_a_link_is_shared(
    server: Server, open_panel: OpenPanel, keep_picture: KeepPicture, size: ViewportSize | None
) -> None:
    page = open_panel(**({} if size is None else {"viewport": size}))
    address, _, token = server.link.partition("/?token=")

    def reached_by_others(route: Route) -> None:
        told = route.fetch().json()
        other = {**told["links"][0], "address": "http://192.168.1.5:8080", "here": False}
        route.fulfill(json={**told, "links": [other, *told["links"]], "note": None})

    page.route("**/api/links?*", reached_by_others)
    from_menu(page, "Share")
    dialog = page.get_by_role("dialog", name="Share this page")
    link = dialog.get_by_label("Link", exact=True)
    expect(link).to_have_value(f"{address}/?token={read_only_token(token)}")
    code = dialog.get_by_role("img", name="QR code of the link")
    page.wait_for_function("image => image.naturalWidth > 0", arg=code.element_handle())
    before = code.get_attribute("src")
    keep_picture(page, f"share-{'desktop' if size is None else 'phone'}")
    dialog.get_by_label("Operator").check()
    expect(link).to_have_value(server.link)
    expect(dialog.get_by_text("Treat it like a password")).to_be_visible()
    assert code.get_attribute("src") != before
    dialog.get_by_role("button", name="Copy").click()
    expect(dialog.get_by_role("button", name="Copied")).to_be_visible()
    # No phone can open what only this computer can.
    dialog.get_by_label("Address").select_option(label=f"{address} (this computer)")
    expect(code).to_be_hidden()
    dialog.get_by_role("button", name="Close").click()
    expect(dialog).to_be_hidden()


def test_where_nobody_else_can_come_the_dialog_says_what_to_do(open_panel: OpenPanel) -> None:
    page = open_panel(viewport=PHONE)
    from_menu(page, "Share")
    dialog = page.get_by_role("dialog", name="Share this page")
    expect(dialog.get_by_text("--host 0.0.0.0")).to_be_visible()
    expect(dialog.get_by_alt_text("QR code of the link")).to_be_hidden()


def test_who_only_watches_is_told_once_and_changes_nothing(
    server: Server, watching: Page, keep_picture: KeepPicture
) -> None:
    page = watching
    expect(page.get_by_text("Watching only")).to_be_visible()
    expect(page.get_by_role("button", name="Start run")).to_be_hidden()
    expect(page.locator("observer-playback").get_by_role("button").first).to_be_disabled()
    page.get_by_role("tab", name="Parameters").click()
    form = page.locator("observer-parameters")
    expect(form.locator("observer-parameter").first).to_be_visible()
    expect(form.locator('input[type="number"]:enabled, input[type="range"]:enabled')).to_have_count(
        0
    )
    # What only looks stays.
    expect(form.locator("#parameter-search")).to_be_enabled()
    keep_picture(page, "watching-only")
    before = server.get("/parameters")["revision"]
    answer = page.evaluate(
        """async () => {
          const options = { method: "PATCH", body: "{}",
            headers: { "content-type": "application/json" } };
          const answer = await fetch("/api/parameters", options);
          return [answer.status, (await answer.json()).detail];
        }"""
    )
    assert answer == [403, WATCHING_ONLY]
    assert server.get("/parameters")["revision"] == before
    # Everybody who sees something go wrong may stop the robots.
    stop = page.locator("#stop-robots")
    expect(stop).to_be_enabled()
    from_menu(page, "Share")
    dialog = page.get_by_role("dialog", name="Share this page")
    expect(dialog.get_by_label("Watch only")).to_be_checked()
    expect(dialog.get_by_label("Operator")).to_have_count(0)


def test_the_keys_are_listed(open_panel: OpenPanel, keep_picture: KeepPicture) -> None:
    page = open_panel()
    dialog = page.get_by_role("dialog", name="Keyboard")
    # In a field it is a letter like any other.
    page.get_by_role("tab", name="Parameters").click()
    field = page.locator("#parameter-search")
    field.press("?")
    expect(dialog).to_be_hidden()
    expect(field).to_have_value("?")
    field.fill("")
    page.get_by_role("tab", name="Parameters").focus()
    page.keyboard.press("?")
    expect(dialog).to_be_visible()
    expect(dialog.get_by_text("Stop all robots")).to_be_visible()
    expect(dialog.get_by_text("Undo the last change")).to_be_attached()
    keep_picture(page, "keyboard")
    page.keyboard.press("Escape")
    expect(dialog).to_be_hidden()
    from_menu(page, "Keyboard")
    expect(dialog).to_be_visible()


def test_what_happened_stays_readable(
    server: Server, open_panel: OpenPanel, keep_picture: KeepPicture
) -> None:
    page = open_panel()
    page.get_by_role("tab", name="Status").click()
    log = page.locator("observer-log")
    expect(log.get_by_text("Server started.")).to_be_attached()
    run = server.api.post("/api/runs", json={"name": "logged", "source": "simulated:lab"}).json()
    expect(log.get_by_role("listitem").filter(has_text="Run logged started.")).to_be_attached()
    refused = server.api.post("/api/runs", json={"source": "simulated:lab"})
    assert refused.status_code == 409
    server.api.post(f"/api/runs/{run['id']}/stop")
    # The newest first.
    expect(log.get_by_role("listitem").first).to_contain_text("Run logged ended.")
    log.get_by_label("Only warnings and errors").check()
    expect(log.get_by_role("listitem").first).to_contain_text("Refused: ")
    expect(log.get_by_text("Server started.")).to_have_count(0)
    log.scroll_into_view_if_needed()
    keep_picture(page, "log")
    with page.expect_download() as saved:
        log.get_by_role("button", name="Save as text").click()
    assert "INFO Server started." in saved.value.path().read_text()
