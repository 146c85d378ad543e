"""The page's budget: weight, layout stability while data flows, time until usable, latency.

The measurements are printed for those who run it with -s on a quiet machine. The time limits are
wide: the tests shall pass next to other tests, and fail if the page has become several times
slower. The wanted values are retried only outside CI, whose machines never reach them.
"""

from __future__ import annotations

import os
import sys
from typing import Any

import pytest
from playwright.sync_api import Page

from .conftest import DESKTOP, Eventually, OpenPanel, Server

_PHONE = {"width": 390, "height": 844}
# Everything the page loads to become usable, except the 3D scene.
_WEIGHT_BYTES = 500_000
_FLOWING_MS = 8000
# Wanted on a quiet machine with two cores.
_USABLE_WANTED_S = 2.0
_LATENCY_WANTED_MS = 100.0
_USABLE_WITHIN_S = 10.0
_LATENCY_MEDIAN_MS, _LATENCY_P95_MS = 500.0, 2000.0
_TRIES = 1 if os.environ.get("CI") else 3

# Record every layout shift not caused by a key or click, and when live data was first shown.
_WATCH = """() => {
  performance.setResourceTimingBufferSize(2000);
  window.shifts = [];
  const named = ({ node }) => {
    const element = node instanceof Element ? node : node?.parentElement;
    return element ? element.cloneNode(false).outerHTML.slice(0, 100) : "gone";
  };
  new PerformanceObserver((list) => {
    for (const { value, hadRecentInput, startTime, sources } of list.getEntries())
      if (!hadRecentInput) window.shifts.push(
        { value, at: Math.round(startTime), moved: sources.map(named) });
  }).observe({ type: "layout-shift", buffered: true });
  const look = () => {
    const fresh = document.documentElement?.dataset.freshness === "fresh";
    if (fresh) window.freshAt = performance.now();
    else requestAnimationFrame(look);
  };
  look();
}"""
# Time until the effect of a press is visible.
_PRESS = """() => new Promise((done) => {
  const start = performance.now();
  document.querySelector('[popovertarget="page-menu"]').click();
  const open = document.querySelector("#page-menu").matches(":popover-open");
  requestAnimationFrame(() => requestAnimationFrame(() =>
    done(open ? performance.now() - start : Infinity)));
})"""
# Everything this document loaded: path, bytes over the network with headers, and unpacked.
_LOADED = """() => [
  ...performance.getEntriesByType("navigation"),
  ...performance.getEntriesByType("resource"),
].filter(({ name }) => !new URL(name).pathname.startsWith("/viewer"))
 .map((e) => ({
   name: new URL(e.name).pathname, sent: e.transferSize, plain: e.decodedBodySize }))"""


def _tell(measured: str) -> None:
    sys.stdout.write(f"\n{measured}\n")


@pytest.fixture
def open_watched(open_panel: OpenPanel) -> OpenPanel:
    """Open the page as in a browser's first visit, watched from the first moment."""

    def open_one(**options: Any) -> Page:
        page = open_panel(script=f"({_WATCH})()", **options)
        page.wait_for_function("() => window.freshAt", timeout=30_000)
        return page

    return open_one


def test_page_weight_is_within_budget(open_watched: OpenPanel) -> None:
    page = open_watched()
    # Include what is loaded after the page has appeared.
    page.wait_for_timeout(2000)
    loaded = page.evaluate(_LOADED)
    sent, plain = (sum(each[kind] for each in loaded) for kind in ("sent", "plain"))
    heaviest = sorted(loaded, key=lambda each: each["sent"], reverse=True)[:8]
    told = ", ".join(f"{each['name']} {each['sent'] / 1000:.1f}" for each in heaviest)
    _tell(f"{len(loaded)} files, {sent / 1000:.0f} kB, unpacked {plain / 1000:.0f} kB; {told} kB")
    assert len(loaded) > 100
    assert all(each["sent"] for each in loaded if each["plain"]), "came from a cache"
    assert sent < _WEIGHT_BYTES, told


@pytest.mark.parametrize("size", [DESKTOP, _PHONE], ids=["desktop", "phone"])
def test_layout_is_stable_while_data_flow(open_watched: OpenPanel, size: Any) -> None:
    page = open_watched(viewport=size)
    page.wait_for_timeout(_FLOWING_MS)
    shifts = page.evaluate("window.shifts")
    _tell(f"cumulative layout shift {sum(each['value'] for each in shifts):.4f}")
    assert shifts == [], "\n".join(str(each) for each in shifts)
    # Make sure that the browser reports shifts at all.
    page.evaluate("document.querySelector('main').style.marginTop = '80px'")
    page.wait_for_function("() => window.shifts.length > 0")


@pytest.mark.parametrize("viewer", [False, True], ids=["page", "with 3D"])
def test_the_page_is_usable_in_time(open_watched: OpenPanel, viewer: bool) -> None:
    took = []
    for _ in range(_TRIES):
        page = open_watched(viewer=viewer)
        fresh, pressed = page.evaluate("window.freshAt"), page.evaluate(_PRESS)
        took.append((fresh + pressed) / 1000)
        page.context.close()
        if took[-1] < _USABLE_WANTED_S:
            break
    _tell(f"usable after {', '.join(f'{each:.2f}' for each in took)} s")
    assert min(took) < _USABLE_WITHIN_S


@pytest.mark.parametrize("viewer", [False, True], ids=["page", "with 3D"])
def test_latency_from_exposure_to_paint_is_within_budget(
    server: Server, open_panel: OpenPanel, eventually: Eventually, viewer: bool
) -> None:
    """A simulated frame is exposed when it is played; the server measures from then until the page
    has painted and acknowledged it, on a single clock.
    """
    open_panel(viewer=viewer).wait_for_timeout(1000)
    told: list[Any] = []
    for _ in range(_TRIES):
        # Opening a source restarts the statistics.
        server.api.put("/api/source", json={"source": "simulated:lab"}).raise_for_status()
        told.append(eventually(lambda: (now := _latency(server))["count"] > 60 and now, 40))
        if told[-1]["p95"] < _LATENCY_WANTED_MS:
            break
    _tell("; ".join(f"median {each['median']} ms, p95 {each['p95']} ms" for each in told))
    assert min(each["median"] for each in told) < _LATENCY_MEDIAN_MS
    assert min(each["p95"] for each in told) < _LATENCY_P95_MS


def _latency(server: Server) -> Any:
    return server.get("/status")["latency_ms"]
