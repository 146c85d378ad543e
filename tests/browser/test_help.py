"""The documentation in a browser, under the server's content security policy."""

from __future__ import annotations

from playwright.sync_api import expect

from .conftest import KeepPicture, OpenPanel, Server


def test_help_is_readable_and_searchable_without_external_resources(
    open_panel: OpenPanel, server: Server, keep_picture: KeepPicture
) -> None:
    """Anything the policy refuses is an error on the console, which fails the test."""
    page = open_panel()
    page.get_by_role("button", name="Menu").click()
    link = page.get_by_role("link", name="Help")
    expect(link).to_have_attribute("target", "_blank")
    page.goto(server.link.partition("/?")[0] + link.get_attribute("href"))
    expect(page.get_by_role("heading", name="Dynamic Observer", level=1)).to_be_visible()
    keep_picture(page, "help")
    page.get_by_role("link", name="Accuracy").first.click()
    expect(page.get_by_role("cell", name="centre RMSE, m")).to_be_visible()
    # Key by key: once the search is ready, it listens only to key events.
    page.get_by_role("textbox", name="Search").press_sequentially("vergence")
    expect(page.locator(".md-search-result__item").first).to_be_visible(timeout=20_000)
    keep_picture(page, "help-search")
