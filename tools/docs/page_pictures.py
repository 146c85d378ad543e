"""Make the documentation's pictures of the page, each in light and dark.

    python -m tools.docs.page_pictures [NAME...]

One server and one Chromium; every picture is of a real observation. Takes some minutes.
"""

from __future__ import annotations

import io
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from PIL import Image
from playwright.sync_api import Browser, Page, ViewportSize, sync_playwright

from app.client.server_process import RunningServer, running_server

ROOT = Path(__file__).resolve().parents[2]
IMAGES = ROOT / "docs" / "pages" / "images"
_QUALITY = 72
_DESKTOP: ViewportSize = {"width": 1440, "height": 900}
_PHONE: ViewportSize = {"width": 390, "height": 844}
# Speeds fill a good part of their chart, and a run is worth a report.
_RUN_S = 25.0
_LONG_MS = 180_000
# WebGL by the processor, where no graphics card is.
_OPTIONS = ("--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader")


@dataclass(frozen=True)
class Shot:
    """One picture of the page.

    Attributes:
        name: of its files: ``name-light.webp`` and ``name-dark.webp``.
        prepare: leads a signed-in page to what is shown.
        size: of the window, CSS pixels.
    """

    name: str
    prepare: Callable[[Page, RunningServer], None]
    size: ViewportSize


def _live(page: Page, _: RunningServer) -> None:
    # The scene is drawn by the processor, which takes a while.
    page.wait_for_selector('html[data-freshness="fresh"]')
    page.wait_for_timeout(12_000)


def _compare(page: Page, server: RunningServer) -> None:
    _go(page, server, "#methods")
    compare = page.get_by_role("button", name="Compare methods")
    if page.locator("observer-methods-split").is_hidden():
        compare.click()
    page.locator("observer-methods-split").wait_for(timeout=_LONG_MS)
    page.get_by_role("slider").first.fill("90")
    page.wait_for_timeout(1500)


def _run(page: Page, server: RunningServer) -> None:
    _go(page, server, f"#history/{_newest_run(server)}")
    page.locator("observer-run canvas").first.wait_for()
    page.wait_for_timeout(4000)


def _calibration(page: Page, server: RunningServer) -> None:
    if server.request("GET", "/api/status")["source"]["spec"] != "simulated:calibration":
        server.request("PUT", "/api/source", {"source": "simulated:calibration"})
        page.get_by_role("tab", name="Calibration").click()
        page.locator("observer-calibration button", has_text="Calibrate").first.click()
        page.get_by_role("button", name="Start", exact=False).first.click()
    page.locator("observer-capture-step").wait_for()
    page.wait_for_timeout(20_000)


def _report(page: Page, server: RunningServer) -> None:
    page.goto(f"http://127.0.0.1:{server.port}/api/runs/{_newest_run(server)}/report")
    page.wait_for_timeout(2000)


# What changes the source comes last.
SHOTS = (
    Shot("panel", _live, _DESKTOP),
    Shot("phone", _live, _PHONE),
    Shot("run", _run, _DESKTOP),
    Shot("compare", _compare, _DESKTOP),
    Shot("report", _report, _DESKTOP),
    Shot("calibration", _calibration, _DESKTOP),
)


def write(folder: Path, names: list[str]) -> None:
    """Write the named pictures, or all, into a folder."""
    with running_server("simulated:lab") as server, _chromium() as browser:
        server.wait_for_frames()
        run = server.request("POST", "/api/runs", {"name": "Half circles"})
        time.sleep(_RUN_S)
        server.request("POST", f"/api/runs/{run['id']}/stop")
        for shot in SHOTS:
            if not names or shot.name in names:
                for scheme in ("light", "dark"):
                    _take(browser, server, shot, scheme, folder)


def _take(
    browser: Browser,
    server: RunningServer,
    shot: Shot,
    scheme: Literal["light", "dark"],
    folder: Path,
) -> None:
    context = browser.new_context(viewport=shot.size, color_scheme=scheme)
    context.set_default_timeout(60_000)
    page = context.new_page()
    try:
        page.goto(server.link)
        shot.prepare(page, server)
        picture = Image.open(io.BytesIO(page.screenshot()))
        picture.save(folder / f"{shot.name}-{scheme}.webp", quality=_QUALITY, method=6)
    finally:
        context.close()


def _go(page: Page, server: RunningServer, place: str) -> None:
    page.goto(f"http://127.0.0.1:{server.port}/{place}")


def _newest_run(server: RunningServer) -> str:
    return str(server.request("GET", "/api/runs")[0]["id"])


@contextmanager
def _chromium() -> Iterator[Browser]:
    path = shutil.which("chromium") or shutil.which("google-chrome")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=list(_OPTIONS))
        try:
            yield browser
        finally:
            browser.close()


if __name__ == "__main__":
    write(IMAGES, sys.argv[1:])
