"""Old data never look new: every live part is marked as stale and recovers by itself."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable

import psutil
from playwright.sync_api import Page, expect

from .conftest import Eventually, KeepPicture, OpenPanel, Server

# Seconds: least CPU time an engine needs to start, and how long it is watched for being idle.
_READING_S = 0.4
_IDLE_S = 0.6

# 3D is drawn in software here.
_SMALL = {"width": 1000, "height": 640}

# Record states that are too short to poll.
_REMEMBER = """() => {
  window.seen = [];
  const html = document.documentElement;
  new MutationObserver(() => window.seen.push([
    html.dataset.freshness,
    document.querySelector(".headline-text").innerText,
    document.querySelector("observer-scene").dataset.freshness,
  ])).observe(html, { attributeFilter: ["data-freshness"] });
}"""


def _engines(server: Server) -> list[psutil.Process]:
    """Return the engine and its standby, without which recovery takes a while."""
    children = server.process.children()
    return [each for each in children if "app.engine" in each.cmdline()]


def _both_have_started(server: Server) -> bool:
    """Return whether both engines have started; one hit while starting gets half a minute.

    An engine has started once it has imported all its modules and is idle.
    """
    engines = _engines(server)
    if len(engines) < 2:
        return False
    standby = max(engines, key=psutil.Process.create_time)
    used_s = sum(standby.cpu_times()[:2])
    time.sleep(_IDLE_S)
    return used_s > _READING_S and sum(standby.cpu_times()[:2]) - used_s < 0.1 * _IDLE_S


def _strike(server: Server, page: Page, eventually: Eventually, kind: signal.Signals) -> None:
    """Hit both engines with a signal; the page must say so and go on with the next engine."""
    eventually(lambda: _both_have_started(server), 30)
    engine = server.get("/status")["engine"]
    page.evaluate(_REMEMBER)
    for process in _engines(server):
        process.send_signal(kind)
    page.wait_for_function("() => window.seen.some(([state]) => state === 'stale')", timeout=5_000)
    # Both were hit, so this is a cold start; how fast a standby takes over is tested with the
    # supervisor.
    eventually(lambda: server.get("/status")["engine"]["generation"] > engine["generation"], 20)
    expect(page.locator(".notice")).to_contain_text("restarted")
    page.wait_for_selector('html[data-freshness="fresh"]', timeout=20_000)
    marked = [entry for entry in page.evaluate("window.seen") if entry[0] == "stale"]
    assert marked[0][1].startswith("Stale: ")
    assert marked[0][2] == "stale"
    expect(page.locator(".headline-text")).not_to_contain_text("Stale")


def test_the_page_reports_a_dead_engine_and_continues_with_the_next(
    server: Server, open_panel: OpenPanel, eventually: Eventually
) -> None:
    _strike(server, open_panel(), eventually, signal.SIGKILL)


def test_everything_is_marked_stale_while_the_server_is_silent(
    server: Server,
    open_panel: OpenPanel,
    keep_picture: KeepPicture,
    wait_for_scene: Callable[[Page], None],
) -> None:
    page = open_panel(viewer=True, losses=True, viewport=_SMALL)
    wait_for_scene(page)
    server.process.suspend()
    try:
        asked = time.monotonic()
        # Poll by timer: without new data the page draws few frames.
        page.wait_for_function(
            "() => document.documentElement.dataset.freshness === 'stale'",
            polling=100,
            timeout=6_000,
        )
        assert time.monotonic() - asked < 5
        expect(page.locator("observer-scene")).to_have_attribute("data-freshness", "stale")
        # One message in words, and all live parts greyed out.
        expect(page.locator(".headline-text")).to_contain_text("Stale: The server is not")
        expect(page.locator(".stale-mark:visible")).to_have_count(0)
        expect(page.locator("observer-live-view[data-freshness=stale]")).to_have_count(2)
        for part in ("observer-scene iframe", "observer-speed-chart .chart"):
            opacity = page.locator(part).evaluate("e => getComputedStyle(e).opacity")
            assert float(opacity) < 0.7, part
        keep_picture(page, "stale")
        # An unconfirmed stop is not shown as a stop.
        page.locator("#stop-robots").click()
        expect(page.locator(".notice")).to_contain_text("does not confirm the stop")
    finally:
        server.process.resume()
    page.wait_for_selector('html[data-freshness="fresh"]', timeout=20_000)
    expect(page.locator(".headline-text")).not_to_contain_text("Stale")
    # The stop request was still queued at the server.
    expect(page.locator(".stop-state")).to_contain_text("Stopped by", timeout=10_000)
    page.get_by_role("button", name="Reset", exact=True).first.click()
    expect(page.locator(".stop-latched")).to_be_hidden()


def test_robots_of_a_silent_server_are_not_shown_as_if_known(
    server: Server, open_panel: OpenPanel
) -> None:
    page = open_panel(losses=True)
    page.get_by_role("tab", name="Robots").click()
    robots = page.locator("observer-robots")
    expect(robots.locator(".state-chip").first).to_have_text("Disarmed", timeout=20_000)
    server.process.suspend()
    try:
        # Before the connection counts as lost.
        expect(robots).to_contain_text("The server is not responding. The values", timeout=6_000)
        expect(robots).to_have_attribute("data-old", "")
    finally:
        server.process.resume()
    expect(robots).not_to_have_attribute("data-old", "", timeout=20_000)


def test_the_page_reports_a_hung_engine_and_continues_with_the_next(
    server: Server, open_panel: OpenPanel, eventually: Eventually
) -> None:
    # Last, since by now another standby engine has started.
    _strike(server, open_panel(), eventually, signal.SIGSTOP)
