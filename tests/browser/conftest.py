"""One server and one Chromium for all tests of the page; each test has its own page.

Every page is watched: an error on its console, or a request to another machine, fails the test.
"""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import httpx
import numpy as np
import psutil
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Browser, Locator, Page

ARTEFACTS = Path(__file__).resolve().parents[2] / "artefacts"
DESKTOP = {"width": 1440, "height": 900}

# Types of the fixtures; their arguments are described there.
Json = dict[str, Any]
OpenPanel = Callable[..., Page]
Eventually = Callable[..., Any]
KeepPicture = Callable[[Page, str], None]
Pixels = Callable[..., NDArray[np.uint8]]

# Elements beyond the right edge of the window, except those that scroll by themselves.
TOO_WIDE = """() => [...document.querySelectorAll("body *")]
  .filter((e) => !e.closest(".scroll-x, [role=tablist], .visually-hidden, .uplot"))
  .map((e) => [e, e.getBoundingClientRect()])
  .filter(([, r]) => r.width && r.right > innerWidth + 1)
  .map(([e]) => e)
  .map((e) => e.outerHTML.slice(0, 120))"""

_LOOKS = ("light", "dark", "phone")
_START_S = 40.0
# The comparison runs in a process of the lowest priority.
_COMPARED_S = 120.0
_STOP_S = 10.0
_REFUSED = re.compile(r"the server responded with a status of 4(09|22)")
# Console errors that a page inevitably logs when it loses its server.
_LOST = re.compile(r"WebSocket connection to .* failed|net::ERR_")


def looks(*in_ci: str, of: Sequence[str] = _LOOKS) -> list[Any]:
    """Return the values of a parameter; CI, short of time, uses only those in ``in_ci``."""
    patient = pytest.mark.patient
    return [look if look in in_ci else pytest.param(look, marks=patient) for look in of]


@dataclass(frozen=True)
class Server:
    """A served Dynamic Observer.

    Attributes:
        link: with the token, as printed. api: a client for the REST interface, signed in.
        process: the web process.
    """

    link: str
    api: httpx.Client
    process: psutil.Process

    def get(self, path: str) -> Any:
        """The JSON under ``/api``."""
        answer = self.api.get(f"/api{path}")
        answer.raise_for_status()
        return answer.json()


@pytest.fixture(scope="package", autouse=True)
def _nothing_left_behind(
    no_process_left: Callable[[], AbstractContextManager[None]],
) -> Iterator[None]:
    """Replace the check after every test: server and browser outlive the single test.

    They start and end child processes at any time (renderers, a new engine), so only after the last
    test of the page must nothing be left.
    """
    with no_process_left():
        yield


@pytest.fixture(scope="package")
def server(
    tmp_path_factory: pytest.TempPathFactory, _nothing_left_behind: None
) -> Iterator[Server]:
    """A real server on the simulated lab, started as a user starts it."""
    folder = tmp_path_factory.mktemp("served")
    output = folder / "output.txt"
    command = [
        sys.executable,
        "-m",
        "app.cli",
        "serve",
        "--port",
        "0",
        "--data",
        str(folder / "data"),
    ]
    with output.open("w") as stream:
        process = subprocess.Popen(
            command, stdout=stream, stderr=subprocess.STDOUT, cwd=ARTEFACTS.parent
        )
    try:
        link = _wait_for_link(process, output)
        address, _, token = link.partition("/?token=")
        bearer = {"Authorization": f"Bearer {token}"}
        with httpx.Client(base_url=address, headers=bearer, timeout=30, trust_env=False) as api:
            yield Server(link, api, psutil.Process(process.pid))
        process.send_signal(signal.SIGINT)
        assert process.wait(_STOP_S) == 0, output.read_text()
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
        ARTEFACTS.mkdir(exist_ok=True)
        shown = re.sub(r"token=\S+", "token=TOKEN", output.read_text())
        (ARTEFACTS / "server.log").write_text(shown)


def _wait_for_link(process: subprocess.Popen[bytes], output: Path) -> str:
    deadline = time.monotonic() + _START_S
    while time.monotonic() < deadline:
        found = re.search(r"http://\S+/\?token=\S+", output.read_text())
        if found:
            return found.group()
        assert process.poll() is None, f"the server ended: {output.read_text()}"
        time.sleep(0.05)
    pytest.fail(f"no link within {_START_S:.0f} s: {output.read_text()}")


@pytest.fixture(scope="package")
def browser(
    launched_chromium: Callable[[], AbstractContextManager[Browser]], _nothing_left_behind: None
) -> Iterator[Browser]:
    with launched_chromium() as chromium:
        yield chromium


@pytest.fixture
def open_panel(
    server: Server, browser: Browser, leave_viewer_out: Callable[[Page], None]
) -> Iterator[OpenPanel]:
    """Open the panel in a page of its own, signed in, with live data arriving.

    Arguments of the returned function: ``viewer`` False leaves out the 3D scene, which takes most
    of the time on a machine without a graphics card; ``refusals`` tolerates values refused by the
    server, ``losses`` a lost server; ``script`` runs in the page before its own scripts; anything
    else goes to the browser context.
    """
    opened: list[tuple[Page, list[str], bool, bool]] = []

    def open_one(
        *,
        viewer: bool = False,
        refusals: bool = False,
        losses: bool = False,
        script: str | None = None,
        **options: Any,
    ) -> Page:
        context = browser.new_context(**{"viewport": DESKTOP, **options})
        page = context.new_page()
        troubles = _watch(page, server.link)
        opened.append((page, troubles, refusals, losses))
        if script is not None:
            page.add_init_script(script)
        if not viewer:
            leave_viewer_out(page)
        page.goto(server.link)
        page.wait_for_selector('html[data-freshness="fresh"]', timeout=30_000)
        return page

    yield open_one
    for page, *_ in opened:
        page.context.close()
    # A stop outlives its page and would hide the tour's offer in the next one.
    server.api.post("/api/robots/reset")
    for _, troubles, refusals, losses in opened:
        left = [
            trouble
            for trouble in troubles
            if not (refusals and _REFUSED.search(trouble))
            and not (losses and _LOST.search(trouble))
        ]
        assert not left, left


def _watch(page: Page, link: str) -> list[str]:
    """Return a list that gains a line for every error and every request to another host."""
    troubles: list[str] = []
    host = link.split("/")[2]
    inside = (f"http://{host}/", f"ws://{host}/", "data:", "blob:", f"blob:http://{host}/")

    def requested(url: str) -> None:
        if not url.startswith(inside):
            troubles.append(f"a request left the machine: {url}")

    page.on("request", lambda request: requested(request.url))
    page.on("websocket", lambda socket: requested(socket.url))
    page.on("pageerror", lambda error: troubles.append(f"error: {error}"))
    page.on(
        "console",
        lambda message: (
            troubles.append(f"console: {message.text} {message.location['url']}")
            if message.type == "error"
            else None
        ),
    )
    return troubles


@pytest.fixture(scope="module")
def two_runs(server: Server) -> Iterator[list[str]]:
    """Runs of the same frames by the two methods, from a comparison; none is left behind."""
    server.api.post("/api/comparison/cancel")
    wanted = {"source": "simulated:people", "seconds": 1}
    server.api.post("/api/comparison", json=wanted).raise_for_status()
    deadline = time.monotonic() + _COMPARED_S
    while (status := server.get("/comparison"))["going"] and time.monotonic() < deadline:
        time.sleep(0.1)
    assert status["runs"], status
    yield list(status["runs"])
    for run in server.get("/history")["runs"]:
        server.api.delete(f"/api/runs/{run['id']}")


@pytest.fixture
def lab_before_and_after(server: Server, eventually: Eventually) -> Iterator[None]:
    """The lab is open at the beginning of the test, and again after it, uncalibrated."""
    eventually(lambda: server.get("/status")["engine"]["state"] == "preview", 40)
    yield
    server.api.delete("/api/calibrating")
    if server.get("/status")["source"]["spec"] != "simulated:lab":
        server.api.put("/api/source", json={"source": "simulated:lab"}).raise_for_status()


@pytest.fixture
def keep_picture() -> KeepPicture:
    """Save a screenshot under ``artefacts/`` for people to look at."""

    def keep(page: Page, name: str) -> None:
        ARTEFACTS.mkdir(exist_ok=True)
        page.screenshot(path=ARTEFACTS / f"{name}.png")

    return keep


@pytest.fixture
def pixels() -> Pixels:
    """Return the visible pixels of an element, (H, W, 3)."""

    def take(element: Locator) -> NDArray[np.uint8]:
        picture = cv2.imdecode(np.frombuffer(element.screenshot(), np.uint8), cv2.IMREAD_COLOR)
        return np.asarray(picture, dtype=np.uint8)

    return take


@pytest.fixture
def wait_for_scene(pixels: Pixels, eventually: Eventually) -> Callable[[Page], None]:
    """Wait until the 3D scene is drawn: many different colours, not just the background.

    Without a graphics card compiling its shaders blocks the page for seconds, once: that is over
    when the page draws its next frame.
    """

    def is_drawn(page: Page) -> bool:
        scene = pixels(page.locator("observer-scene iframe"))
        colours = np.unique((scene // 16).reshape(-1, 3), axis=0)
        return bool(scene.std() > 8 and len(colours) > 60)

    def wait(page: Page) -> None:
        eventually(lambda: is_drawn(page), 30)
        page.evaluate("() => new Promise(requestAnimationFrame)")
        eventually(lambda: is_drawn(page), 30)

    return wait


@pytest.fixture(scope="session")
def eventually() -> Eventually:
    """Ask until the answer is true, or ``until`` accepts it; return the answer."""

    def wait(
        ask: Callable[[], Any], within_s: float = 10.0, until: Callable[[Any], bool] = bool
    ) -> Any:
        deadline = time.monotonic() + within_s
        while not until(answer := ask()):
            assert time.monotonic() < deadline, f"not within {within_s} s: {answer}"
            time.sleep(0.05)
        return answer

    return wait
