"""The system's Chromium for tests of the page, and operations on its pages."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from playwright.sync_api import Browser, Page, sync_playwright

# Software WebGL where there is no graphics card; no services of the browser's vendor.
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
    """Launch a headless Chromium."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=list(_OPTIONS))
        try:
            yield browser
        finally:
            browser.close()


def without_viewer(page: Page) -> None:
    """Leave out the 3D scene, which takes most of the time without a graphics card."""
    page.route("**/viewer/**", lambda route: route.fulfill(body=_BLANK, content_type="text/html"))


def hide(page: Page, hidden: bool) -> None:
    """Hide or show a page as if switching tabs, which a headless browser does not do itself."""
    page.evaluate(_HIDE, hidden)
