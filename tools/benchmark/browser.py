"""Figures of one user in front of a visible Chromium, and the page's latency."""

from __future__ import annotations

import shutil
import time
from dataclasses import dataclass

from app.client.server_process import RunningServer

_CHROMIUM_NAMES = ("chromium", "chromium-browser", "google-chrome")
_SETTLING_MS = 3000
_ARGUMENTS = (
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",
)


@dataclass(frozen=True)
class PageFigures:
    """Figures of one visible page.

    Attributes:
        first_obstacle_s: from the server's start to the first obstacle in the page's headline;
            None if there was none in time.
        latency_median_ms, latency_p95_ms: from a frame's reception to the page's acknowledgement
            after painting, over ``count`` observations.
    """

    first_obstacle_s: float | None
    latency_median_ms: float | None
    latency_p95_ms: float | None
    count: int


def page_figures(
    server: RunningServer, source: str, seconds: float, patience_s: float
) -> PageFigures | str:
    """Open the panel in Chromium, wait for an obstacle, then watch for ``seconds``.

    Returns a sentence instead where no browser can be started.
    """
    executable = next((path for name in _CHROMIUM_NAMES if (path := shutil.which(name))), None)
    if executable is None:
        return "not measured: no Chromium on this machine (apt-get install chromium)"
    try:
        from playwright.sync_api import TimeoutError as WaitTimeout
        from playwright.sync_api import sync_playwright
    except ImportError:
        return "not measured: playwright is not installed (pip install playwright)"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=executable, args=list(_ARGUMENTS), headless=True
        )
        try:
            page = browser.new_page(viewport={"width": 1440, "height": 900})
            page.goto(server.link)
            first: float | None
            try:
                page.get_by_text("m/s", exact=False).first.wait_for(timeout=patience_s * 1000)
                page.wait_for_function(
                    "() => /Obstacle \\d+/.test(document.body.innerText)",
                    timeout=patience_s * 1000,
                )
                first = time.monotonic() - server.started
            except WaitTimeout:
                first = None
            # Reopened, so that the figures describe a loaded page, not one that is loading.
            page.wait_for_timeout(_SETTLING_MS)
            server.request("PUT", "/api/source", {"source": source})
            page.wait_for_timeout(seconds * 1000)
            latency = server.request("GET", "/api/status")["latency_ms"]
        finally:
            browser.close()
    return PageFigures(first, latency["median"], latency["p95"], latency["count"])
