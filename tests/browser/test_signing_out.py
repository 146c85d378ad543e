"""Signing in and out as users do it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, ViewportSize, expect

from .conftest import KeepPicture, Server

PHONE: ViewportSize = {"width": 390, "height": 844}
SIGNED_OUT = "**/sign-in#signed-out"


@pytest.fixture
def context(browser: Browser, leave_viewer_out: Callable[[Page], None]) -> Iterator[BrowserContext]:
    context = browser.new_context(viewport=PHONE)
    context.on("page", leave_viewer_out)
    yield context
    context.close()


def _opened(context: BrowserContext, link: str) -> Page:
    page = context.new_page()
    page.goto(link)
    expect(page.locator("observer-headline")).to_be_visible()
    return page


def test_signing_out_ends_both_tabs_and_the_token_signs_in_again(
    server: Server, context: BrowserContext, keep_picture: KeepPicture
) -> None:
    page, other_tab = _opened(context, server.link), _opened(context, server.link)
    page.get_by_role("button", name="Menu").click()
    page.get_by_role("button", name="Sign out").click()
    question = page.get_by_role("dialog", name="Sign out?")
    keep_picture(page, "sign-out")
    question.get_by_role("button", name="Cancel").click()
    expect(question).to_be_hidden()
    page.get_by_role("button", name="Menu").click()
    page.get_by_role("button", name="Sign out").click()
    question.get_by_role("button", name="Sign out", exact=True).click()
    for each in (page, other_tab):
        each.wait_for_url(SIGNED_OUT)
        expect(each.get_by_text("You are signed out.")).to_be_visible()
    assert context.cookies() == []
    page.get_by_label("Token").fill("wrong")
    page.get_by_role("button", name="Sign in").click()
    expect(page.get_by_role("alert")).to_contain_text("Wrong token")
    page.get_by_label("Token").fill(server.link.partition("?token=")[2])
    page.get_by_role("button", name="Sign in").click()
    expect(page.locator("observer-headline")).to_be_visible()
    # The other tab is let in without asking for the token.
    other_tab.goto("/".join([*server.link.split("/")[:3], "sign-in"]))
    expect(other_tab.locator("observer-headline")).to_be_visible()
    # As from another browser: both tabs are signed out at once.
    assert server.api.delete("/api/sessions").is_success
    for each in (page, other_tab):
        each.wait_for_url(SIGNED_OUT)


def test_a_link_on_another_site_signs_in(server: Server, context: BrowserContext) -> None:
    """Browsers omit strict cookies on links from other sites: the page retries by itself."""
    page = context.new_page()
    address = server.link.partition("?token=")[0]
    with _page_of_another_site(server.link, address) as url:
        for link in ("#with-token", "#without"):
            page.goto(url)
            page.locator(link).click()
            expect(page.locator("observer-headline")).to_be_visible()
            assert page.url == address


@contextmanager
def _page_of_another_site(link: str, address: str) -> Iterator[str]:
    """Serve a page from localhost, which is another site than 127.0.0.1."""
    body = f'<a id="with-token" href="{link}">a</a> <a id="without" href="{address}">b</a>'

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(body.encode())

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as site:
        serving = Thread(target=partial(site.serve_forever, poll_interval=0.05))
        serving.start()
        try:
            yield f"http://localhost:{site.server_port}/"
        finally:
            site.shutdown()
            serving.join()
