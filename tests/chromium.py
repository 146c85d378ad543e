"""The system's Chromium for tests of the page, and what is done to pages in it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from playwright.sync_api import Browser, Page, sync_playwright

# WebGL by the processor, where no graphics card is; no service of the browser's maker.
_OPTIONS = (
    "--no-sandbox",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
_BLANK = "<!doctype html><title>no viewer in this test</title>"
_HIDE = """(hidden) => {
  Object.defineProperty(document, "hidden", { value: hidden, configurable: true });
  document.dispatchEvent(new Event("visibilitychange"));
}"""


@contextmanager
def launched(path: str) -> Iterator[Browser]:
    """A Chromium without a window."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=list(_OPTIONS))
        try:
            yield browser
        finally:
            browser.close()


def without_viewer(page: Page) -> None:
    """Without the 3D scene, which takes most of the time where there is no graphics card."""
    page.route("**/viewer/**", lambda route: route.fulfill(body=_BLANK, content_type="text/html"))


def hide(page: Page, hidden: bool) -> None:
    """As when another tab is chosen, and this one again; a browser without a window hides none."""
    page.evaluate(_HIDE, hidden)
