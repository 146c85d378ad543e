"""Sharing a link, watching through one, the list of keys and the log, as users do it."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
from playwright.sync_api import Browser, Page, Route, ViewportSize, expect

from .conftest import KeepPicture, OpenPanel, Server

PHONE: ViewportSize = {"width": 390, "height": 844}
WATCHING_ONLY = "This link is read-only. Ask for an operator link to change anything."


@pytest.fixture
def watching(
    server: Server, browser: Browser, leave_viewer_out: Callable[[Page], None]
) -> Iterator[Page]:
    """The page as seen through a read-only link."""
    context = browser.new_context()
    page = context.new_page()
    leave_viewer_out(page)
    page.goto(read_only_link(server))
    page.wait_for_selector('html[data-freshness="fresh"]', timeout=30_000)
    yield page
    context.close()


def read_only_link(server: Server) -> str:
    return str(server.get("/links")["links"][-1]["link"])


def from_menu(page: Page, name: str) -> None:
    page.get_by_role("button", name="Menu").click()
    page.locator("#page-menu").get_by_role("button", name=name).click()


@pytest.mark.parametrize("size", [None, PHONE], ids=["desktop", "phone"])
def test_a_link_is_shared(
    server: Server, open_panel: OpenPanel, keep_picture: KeepPicture, size: ViewportSize | None
) -> None:
    page = open_panel(**({} if size is None else {"viewport": size}))
    address = server.link.partition("/?token=")[0]

    def reached_by_others(route: Route) -> None:
        told = route.fetch().json()
        other = {**told["links"][0], "address": "http://192.168.1.5:8080", "here": False}
        route.fulfill(json={**told, "links": [other, *told["links"]], "note": None})

    page.route("**/api/links?*", reached_by_others)
    from_menu(page, "Share")
    dialog = page.get_by_role("dialog", name="Share this page")
    link = dialog.get_by_label("Link", exact=True)
    expect(link).to_have_value(read_only_link(server))
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
    # A phone cannot open an address that works only on this computer.
    dialog.get_by_label("Address").select_option(label=f"{address} (this computer)")
    expect(code).to_be_hidden()
    dialog.get_by_role("button", name="Close").click()
    expect(dialog).to_be_hidden()


def test_the_dialog_explains_how_to_enable_remote_access(open_panel: OpenPanel) -> None:
    page = open_panel(viewport=PHONE)
    from_menu(page, "Share")
    dialog = page.get_by_role("dialog", name="Share this page")
    expect(dialog.get_by_text("--host 0.0.0.0")).to_be_visible()
    expect(dialog.get_by_alt_text("QR code of the link")).to_be_hidden()


def test_a_read_only_viewer_is_notified_once_and_changes_nothing(
    server: Server, watching: Page, keep_picture: KeepPicture
) -> None:
    page = watching
    expect(page.get_by_text("Read-only", exact=True)).to_be_visible()
    expect(page.get_by_role("button", name="Start run")).to_be_hidden()
    pause = page.locator("observer-playback").get_by_role("button").first
    expect(pause).to_be_disabled()
    expect(pause).to_have_attribute("title", WATCHING_ONLY)
    page.get_by_role("tab", name="Parameters").click()
    form = page.locator("observer-parameters")
    expect(form.locator("observer-parameter").first).to_be_visible()
    expect(form.locator('input[type="number"]:enabled, input[type="range"]:enabled')).to_have_count(
        0
    )
    # Harmless controls stay enabled.
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
    # Anyone who sees something go wrong may stop the robots.
    stop = page.locator("#stop-robots")
    expect(stop).to_be_enabled()
    from_menu(page, "Share")
    dialog = page.get_by_role("dialog", name="Share this page")
    expect(dialog.get_by_label("Read-only", exact=True)).to_be_checked()
    expect(dialog.get_by_label("Operator")).to_have_count(0)
    expect(dialog.get_by_role("button", name="Revoke")).to_have_count(0)
    dialog.get_by_role("button", name="Close").click()
    from_menu(page, "Sign out")
    dialog = page.get_by_role("dialog", name="Sign out?")
    expect(dialog.get_by_role("button", name="Sign out everywhere")).to_be_disabled()
    expect(dialog.get_by_role("button", name="Sign out", exact=True)).to_be_enabled()
    dialog.get_by_role("button", name="Cancel").click()


def test_a_read_only_viewer_can_only_stop(
    server: Server, watching: Page, keep_picture: KeepPicture
) -> None:
    page = watching
    recorded = {"name": "watched", "source": "simulated:lab", "record": "jpeg"}
    run = server.api.post("/api/runs", json=recorded).json()["id"]
    page.wait_for_timeout(1500)
    server.api.post(f"/api/runs/{run}/stop").raise_for_status()
    server.api.post("/api/robots/stop").raise_for_status()
    reset = page.locator("observer-stop-line").get_by_role("button", name="Reset")
    expect(reset).to_be_visible()
    expect(reset).to_be_disabled()
    expect(reset).to_have_attribute("title", WATCHING_ONLY)
    expect(page.locator("#stop-robots")).to_be_enabled()
    server.api.post("/api/robots/reset").raise_for_status()

    page.get_by_role("tab", name="Runs").click()
    for name in ("Save last 30 s", "Delete run watched"):
        expect(page.locator("observer-runs").get_by_role("button", name=name)).to_be_disabled()
    page.get_by_role("tab", name="Calibration").click()
    expect(page.locator("#pane-calibration button:enabled:visible")).to_have_count(0)
    page.get_by_role("tab", name="Robots").click()
    expect(page.locator("#pane-robots button:enabled:visible")).to_have_count(0)

    page.evaluate(f"location.hash = '#runs/{run}'")
    view = page.locator("observer-run")
    expect(view.get_by_label("Position in the run")).to_be_enabled(timeout=30_000)
    for name in ("Open in 3D", "Re-run", "Add"):
        button = view.get_by_role("button", name=name, exact=True)
        expect(button).to_be_disabled()
        expect(button).to_have_attribute("title", WATCHING_ONLY)
    expect(page.get_by_role("button", name="Delete run")).to_be_disabled()
    expect(view.get_by_label("Name", exact=True).last).to_be_disabled()
    # Harmless controls work as for everyone.
    expect(page.locator(".run-actions").get_by_role("button", name="Export")).to_be_enabled()
    expect(view.get_by_role("button", name="Play", exact=True)).to_be_enabled()
    view.get_by_role("button", name="Play", exact=True).click()
    keep_picture(page, "watching-a-run")
    page.evaluate("location.hash = '#methods'")
    expect(page.get_by_role("button", name="Compare methods")).to_be_disabled()
    expect(page.locator("#page-title")).to_have_text("Compare methods")
    expect(page.get_by_role("button", name="Delete run")).to_be_hidden()


def test_a_link_is_revoked(
    server: Server, open_panel: OpenPanel, watching: Page, keep_picture: KeepPicture
) -> None:
    page = open_panel()
    before = read_only_link(server)
    page.locator(".top > observer-share").get_by_role("button").click()
    dialog = page.get_by_role("dialog", name="Share this page")
    rows = dialog.get_by_role("region", name="Read-only links").get_by_role("listitem")
    expect(rows).to_have_count(1)
    expect(rows).to_contain_text("browser is watching")
    dialog.get_by_role("button", name="New link").click()
    expect(rows).to_have_count(2)
    expect(rows.first).to_contain_text("the link above")
    expect(rows.first).to_contain_text("Nobody is watching")
    link = dialog.get_by_label("Link", exact=True)
    expect(link).not_to_have_value(before)
    keep_picture(page, "links-in-force")
    rows.last.get_by_role("button", name="Revoke").click()
    sure = page.get_by_role("dialog", name="Revoke the link")
    expect(sure).to_contain_text("1 browser is signed out at once")
    sure.get_by_role("button", name="Revoke link").click()
    expect(rows).to_have_count(1)
    watching.wait_for_url("**/sign-in#signed-out", timeout=5_000)
    assert server.api.get(before, headers={"Authorization": ""}).status_code == 401
    # The list is not about links for operators.
    dialog.get_by_label("Operator").check()
    expect(dialog.get_by_role("region", name="Read-only links")).to_be_hidden()


def test_a_phone_shows_the_method_and_links_to_its_parameters(open_panel: OpenPanel) -> None:
    page = open_panel(viewport={"width": 360, "height": 740})
    method = page.locator(".method-now")
    expect(method).to_have_text("default")
    inside = page.evaluate(
        """() => [...document.querySelectorAll(".top button")]
          .filter((each) => each.checkVisibility())
          .map((each) => each.getBoundingClientRect())
          .filter(({ width }) => width > 0)
          .sort((a, b) => a.left - b.left)
          .every(({ left }, at, all) => at === 0 || left >= all[at - 1].right - 1.5)"""
    )
    assert inside
    method.click()
    expect(page.get_by_role("tab", name="Parameters")).to_have_attribute("aria-selected", "true")
    expect(page.locator("#preset")).to_be_visible()


def test_keyboard_shortcuts_are_listed(open_panel: OpenPanel, keep_picture: KeepPicture) -> None:
    page = open_panel()
    dialog = page.get_by_role("dialog", name="Keyboard")
    # In a field it is an ordinary character.
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


def test_past_events_stay_readable(
    server: Server, open_panel: OpenPanel, keep_picture: KeepPicture
) -> None:
    page = open_panel()
    page.get_by_role("tab", name="Status").click()
    log = page.locator("observer-log")
    expect(log.get_by_text("Server started.")).to_be_attached()
    run = server.api.post("/api/runs", json={"name": "logged", "source": "simulated:lab"}).json()
    expect(log.get_by_role("listitem").filter(has_text='Run "logged" started.')).to_be_attached()
    refused = server.api.post("/api/runs", json={"source": "simulated:lab"})
    assert refused.status_code == 409
    server.api.post(f"/api/runs/{run['id']}/stop")
    # Newest first.
    expect(log.get_by_role("listitem").first).to_contain_text('Run "logged" ended.')
    log.get_by_label("Only warnings and errors").check()
    expect(log.get_by_role("listitem").first).to_contain_text("Refused: ")
    expect(log.get_by_text("Server started.")).to_have_count(0)
    log.scroll_into_view_if_needed()
    keep_picture(page, "log")
    with page.expect_download() as saved:
        log.get_by_role("button", name="Save as text").click()
    assert "INFO Server started." in saved.value.path().read_text()
