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
from playwright.sync_api import Browser, Page, ViewportSize, expect, sync_playwright

from app.client.server_process import RunningServer, running_server
from tools import ROOT

IMAGES = ROOT / "docs" / "pages" / "images"
_QUALITY = 72
_DESKTOP: ViewportSize = {"width": 1280, "height": 800}
# All parts of the live view at once.
_LARGE: ViewportSize = {"width": 1440, "height": 900}
_PHONE: ViewportSize = {"width": 390, "height": 844}
# Frames that make a run worth a report, and a chart worth a look; number of captured views.
_RUN_FRAMES = 375
_CHART_FRAMES = 240
_VIEWS = 7
_LONG_MS = 300_000
# Time in which even a busy computer draws the scene without a graphics card.
_DRAWN_MS = 15_000
_SLOW_RATE = 0.25
# Colours: the controls and axes alone have fewer; a point cloud has tens of thousands.
_EMPTY_SCENE = 5000
# Software WebGL, for computers without a graphics card.
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


def _live(page: Page, server: RunningServer) -> None:
    # Slowly, so that a busy computer keeps up and the page is sent every frame.
    _play(server, _SLOW_RATE)
    _observe(server, _CHART_FRAMES)
    # Paused, because what is drawn late would be shown as stale.
    _pause(server)
    _wait(lambda: _scene_colours(page) > _EMPTY_SCENE)
    page.wait_for_timeout(_DRAWN_MS)


def _scene_colours(page: Page) -> int:
    picture = Image.open(io.BytesIO(page.locator("observer-scene").screenshot())).convert("RGB")
    return len(picture.getcolors(picture.width * picture.height) or ())


def _compare(page: Page, server: RunningServer) -> None:
    # A comparison starts by itself if none was made, and needs the processor for itself.
    _pause(server)
    _go(page, server, "#methods")
    split = page.locator("observer-methods-split")
    split.wait_for(timeout=_LONG_MS)
    split.get_by_label("Frame", exact=True).fill(str(_most_false(server)))
    page.wait_for_timeout(_DRAWN_MS)


def _run(page: Page, server: RunningServer) -> None:
    _pause(server)
    _go(page, server, f"#runs/{_newest_run(server)}")
    page.locator("observer-run canvas").first.wait_for(timeout=_LONG_MS)
    position = page.get_by_label("Position in the run")
    expect(position).to_be_enabled(timeout=_LONG_MS)
    position.fill(str(_RUN_FRAMES // 2))
    page.wait_for_timeout(_DRAWN_MS)


def _calibration(page: Page, server: RunningServer) -> None:
    if not server.request("GET", "/api/status")["calibrating"]:
        request = {"source": "simulated:calibration", "square_mm": 25}
        server.request("POST", "/api/calibrating", request)
    _play(server)
    page.locator("observer-capture-step").wait_for()
    _wait(lambda: len(server.request("GET", "/api/status")["calibrating"]["views"]) >= _VIEWS)


def _report(page: Page, server: RunningServer) -> None:
    page.goto(f"http://127.0.0.1:{server.port}/api/runs/{_newest_run(server)}/report")
    page.wait_for_timeout(2000)


# Shots that make runs follow those that show the newest; one that changes the source is last.
SHOTS = (
    Shot("panel", _live, _LARGE),
    Shot("phone", _live, _PHONE),
    Shot("run", _run, _DESKTOP),
    Shot("report", _report, _DESKTOP),
    Shot("compare", _compare, _DESKTOP),
    Shot("calibration", _calibration, _DESKTOP),
)


def write(folder: Path, names: list[str]) -> None:
    """Write the named pictures, or all, into a folder."""
    with running_server("simulated:lab") as server, _chromium() as browser:
        server.wait_for_frames()
        run = server.request("POST", "/api/runs", {"name": "Half circles"})
        _observe(server, _RUN_FRAMES)
        server.request("POST", f"/api/runs/{run['id']}/stop")
        _pause(server)
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


def _play(server: RunningServer, rate: float = 1.0) -> None:
    server.request("POST", "/api/playback", {"paused": False, "rate": rate})


def _pause(server: RunningServer) -> None:
    server.request("POST", "/api/playback", {"paused": True, "rate": 1.0})


def _observe(server: RunningServer, frames: int) -> None:
    """Wait until the server has observed this many more frames."""

    def count() -> int:
        return int(server.request("GET", "/api/status")["frames_observed"])

    wanted = count() + frames
    _wait(lambda: count() >= wanted)


def _wait(done: Callable[[], bool]) -> None:
    deadline = time.monotonic() + _LONG_MS / 1000
    while not done():
        if time.monotonic() > deadline:
            raise TimeoutError("the server took too long")
        time.sleep(0.5)


def _most_false(server: RunningServer) -> int:
    """Return the position of the frame in which ``paper`` has the most false obstacles."""
    _, paper = server.request("GET", "/api/runs")[:2]
    frames = server.request("GET", f"/api/runs/{paper['id']}/frames")["frames"]
    counts = [sum(each["false"] for each in frame["obstacles"]) for frame in frames]
    return counts.index(max(counts))


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
