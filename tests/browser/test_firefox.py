"""The panel in Firefox: it opens, is live, can be operated, and its console stays empty."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import pytest

from .conftest import ARTEFACTS, DESKTOP, Eventually, Server

_PHONE = {"width": 390, "height": 844}
# One processor loads the modules, draws the scene and does everything else.
_SLOW_S = 60.0
_NAME = "ego_motion.ransac_threshold_px"
_FIELD = "#parameter-ego_motion-ransac_threshold_px"
_ENTER = "\ue007"

_FRESH = "() => document.documentElement.dataset.freshness === 'fresh'"
_TEXT = "(selector) => document.querySelector(selector)?.innerText.trim() ?? ''"
_WIDTH = "(selector) => document.querySelector(selector)?.width ?? 0"
_DRAWN = """() => [...document.querySelectorAll("canvas")].some(
  (each) => each.getContext("webgl2")?.drawingBufferWidth > 100
)"""
_CLOUD = """() => "/display/world/cloud/points" in (window.__viserSceneTree?.getState() ?? {})"""
_SHOWN = """(name) => document.getElementById(`tab-${name}`).ariaSelected === "true"
  && document.getElementById(`pane-${name}`).innerText.length > 20"""
_REVISION = "() => /^In use since frame/.test(document.querySelector('.revision').innerText.trim())"


@pytest.fixture
def tab(
    launched_firefox: Callable[[Path], AbstractContextManager[Any]], tmp_path: Path
) -> Iterator[Any]:
    with launched_firefox(tmp_path) as firefox:
        yield firefox


@pytest.fixture
def lab(server: Server, eventually: Eventually) -> Iterator[Server]:
    """The server in its initial state; its parameters are restored afterwards."""
    eventually(lambda: server.get("/status")["engine"]["state"] == "preview", 40)
    server.api.post("/api/playback", json={"paused": False}).raise_for_status()
    before = server.get("/parameters")["values"]
    yield server
    server.api.patch("/api/parameters", json=before).raise_for_status()


@pytest.mark.slow
@pytest.mark.timeout(240)
def test_the_panel_works_in_firefox(lab: Server, tab: Any, eventually: Eventually) -> None:
    tab.open(lab.link, **DESKTOP)
    tab.wait_for(_FRESH, within_s=_SLOW_S)
    # The link's secret does not stay in the address.
    assert "token" not in tab.evaluate("() => location.href")
    row = tab.wait_for(_TEXT, "observer-obstacles tbody tr", within_s=_SLOW_S)
    assert "±" in row
    assert tab.wait_for(_WIDTH, 'observer-live-view[data-view="left"] canvas') > 100
    scene = eventually(lambda: tab.frame("/viewer/"), _SLOW_S)
    tab.wait_for(_DRAWN, context=scene, within_s=_SLOW_S)
    tab.wait_for(_CLOUD, context=scene, within_s=_SLOW_S)

    _choose_tab(tab, "parameters")
    tab.click(_FIELD)
    tab.evaluate("(field) => document.querySelector(field).select()", _FIELD)
    tab.press(*"1.7", _ENTER)
    eventually(lambda: lab.get("/parameters")["values"][_NAME] == 1.7, 20)
    tab.wait_for(_REVISION)
    for name in ("source", "robots", "calibration", "runs", "status"):
        _choose_tab(tab, name)
    ARTEFACTS.mkdir(exist_ok=True)
    tab.keep_picture(ARTEFACTS / "firefox.png")

    tab.open(lab.link.partition("?")[0], **_PHONE)
    tab.wait_for(_FRESH, within_s=_SLOW_S)
    assert tab.evaluate("() => document.documentElement.scrollWidth") <= _PHONE["width"]
    tab.keep_picture(ARTEFACTS / "firefox-phone.png")

    assert tab.errors == []
    host = lab.link.split("/")[2]
    inside = (
        f"http://{host}/",
        f"ws://{host}/",
        "data:",
        f"blob:http://{host}/",
        "blob:null",
        "about:",
    )
    assert [each for each in tab.requested if not each.startswith(inside)] == []


def _choose_tab(tab: Any, name: str) -> None:
    """Press a tab and expect its panel to be shown."""
    tab.click(f"#tab-{name}")
    tab.wait_for(_SHOWN, name)
