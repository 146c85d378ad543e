"""Sending the observer to a goal on the page: typed, and by a click on the floor of the scene.

The observer is simulated but driven by the same code as a real one.
"""

from __future__ import annotations

import contextlib
import math
import re
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from playwright.sync_api import Error, Frame, Page, ViewportSize, expect

from .axe import findings
from .conftest import TOO_WIDE, Eventually, KeepPicture, OpenPanel, Pixels, Server
from .goal_steps import (
    DRIVEN_S,
    arm_observer,
    goal_section,
    on_robots_tab,
    open_source,
    until_driving,
)
from .witness import Witness

# Simple enough for slow machines, where late frames would end the drive.
_ROOM = """\
based_on: drive
title: A room to send the observer through
help: The observer stands in a room; the obstacle stands far away in it.
camera: {width: 320, height: 160}
robots:
  - name: P3-DX
    x: 5.5
    y: 2.6
    heading_deg: -90
    size: [0.455, 0.381, 0.33]
texture: {robot: red}
"""
_RATE = 0.6
# Small enough to be drawn in software several times a second, with the panel beside the scene.
_SMALL: ViewportSize = {"width": 980, "height": 620}
_PHONE: ViewportSize = {"width": 390, "height": 844}
_BASE = "/display/world/base"
_MAP = "/display/world/map/cells"
# Position in the frame's window, px, of a place relative to the robot, by the viewer's camera.
_PLACE = """([node, ahead, left]) => {
  const { camera, canvas, nodeRefFromName } = window.__viserMutable;
  const base = nodeRefFromName[node];
  const at = camera.position.clone().set(ahead, left, 0).applyMatrix4(base.matrixWorld);
  at.project(camera);
  const box = canvas.getBoundingClientRect();
  return [box.left + (0.5 + at.x / 2) * box.width, box.top + (0.5 - at.y / 2) * box.height];
}"""
_READY = """(node) => window.__viserSceneTree?.getState()[node]?.visibility === true"""


@pytest.fixture(scope="module")
def room(server: Server, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    scenario = tmp_path_factory.mktemp("room") / "room.yaml"
    scenario.write_text(_ROOM)
    open_source(server, f"simulated:{scenario}")
    server.api.post("/api/playback", json={"rate": _RATE}).raise_for_status()
    yield server
    server.api.delete("/api/goal")
    server.api.post("/api/robots/stop").raise_for_status()
    server.api.post("/api/robots/reset").raise_for_status()
    open_source(server, "simulated:lab")
    server.api.post("/api/playback", json={"rate": 1.0}).raise_for_status()


@pytest.fixture(autouse=True)
def _begin_at_rest(room: Server) -> None:
    room.api.post("/api/robots/stop").raise_for_status()
    room.api.post("/api/robots/reset").raise_for_status()


def test_the_observer_drives_to_a_typed_goal_until_cancelled(
    room: Server, open_panel: OpenPanel, eventually: Eventually, keep_picture: KeepPicture
) -> None:
    page = on_robots_tab(open_panel(refusals=True))
    section = goal_section(page)
    send = section.get_by_role("button", name="Drive there")
    expect(send).to_be_disabled()
    expect(section.locator(".missing")).to_have_text("Arm the observer first.")
    keep_picture(page, "goal-unarmed")
    # By keyboard: Enter in a field sends the goal.
    ahead, error = section.get_by_label("Ahead (m)"), section.locator("#goal-error")
    ahead.fill("")

    def refused() -> str:
        if arm_observer(page):
            ahead.press("Enter")
        return error.inner_text()

    eventually(refused, 30)
    expect(error).to_contain_text("Not sent: enter both distances")
    expect(ahead).to_have_attribute("aria-invalid", "true")
    ahead.fill("3")

    driving, ended = section.locator(".goal-driving"), section.locator(".goal-ended")
    deadline = time.monotonic() + DRIVEN_S
    told = ""
    with Witness(room, "observer") as witness:
        while ended.inner_text() != "The goal was cancelled.":
            assert time.monotonic() < deadline, section.inner_text()
            until_driving(page, lambda: ahead.press("Enter"))
            if witness.first(True, time.monotonic(), 3.0) is None:
                continue
            told = f"{driving.inner_text()}\n{page.locator('.robot-why').inner_text()}"
            keep_picture(page, "goal-driving")
            start = time.monotonic()
            # It may have ended by itself meanwhile.
            with contextlib.suppress(Error):
                driving.get_by_role("button", name="Cancel goal").click(timeout=2000)
            witness.zero_after(start)
            page.wait_for_timeout(300)
    expect(driving).to_be_hidden()
    # The focus is not lost with the button.
    expect(ahead).to_be_focused()
    assert re.search(r"\d m to go · \d:\d\d", told)
    assert "Driving to a goal autonomously." in told
    goal = room.get("/robots")["goal"]
    assert goal["state"] == "ended"
    assert goal["risk_per_metre"] == pytest.approx(0.001)


def test_leaving_the_page_ends_the_drive(
    room: Server,
    open_panel: OpenPanel,
    hide_page: Callable[[Page, bool], None],
    eventually: Eventually,
) -> None:
    page = on_robots_tab(open_panel(refusals=True))
    until_driving(page, goal_section(page).get_by_role("button", name="Drive there").click)
    hide_page(page, True)
    eventually(lambda: room.get("/robots")["goal"]["state"] == "ended", 3)
    hide_page(page, False)
    expect(goal_section(page).locator(".goal-ended")).to_contain_text("aborted: ")


def test_the_risk_defaults_to_the_parameter(room: Server, open_panel: OpenPanel) -> None:
    page = on_robots_tab(open_panel())
    risk = goal_section(page).locator("#goal-risk")
    usual = risk.locator("option").first
    expect(usual).to_have_text("0.001 – default")
    name = "navigation.risk_per_metre"
    try:
        room.api.patch("/api/parameters", json={name: 0.005}).raise_for_status()
        expect(usual).to_have_text("0.005 – default")
        expect(risk).to_have_value("")
    finally:
        room.api.patch("/api/parameters", json={name: 0.001}).raise_for_status()


@pytest.fixture
def scene(
    room: Server, open_panel: OpenPanel, wait_for_scene: Callable[[Page], None]
) -> Iterator[Callable[..., Page]]:
    def open_one(**options: Any) -> Page:
        page = open_panel(viewer=True, refusals=True, **{"viewport": _SMALL, **options})
        wait_for_scene(page)
        return page

    yield open_one
    room.api.post("/api/playback", json={"paused": False}).raise_for_status()


def _viewer(page: Page) -> Frame:
    # Playwright learns of frames only while it is handling a call.
    page.evaluate("0")
    frame = page.frame(url=re.compile("/viewer/"))
    assert frame is not None
    return frame


def _place(page: Page, ahead: float, left: float) -> tuple[float, float]:
    """Return where a place relative to the robot is drawn in the page, px."""
    x, y = _viewer(page).evaluate(_PLACE, [_BASE, ahead, left])
    box = page.locator("observer-scene iframe").bounding_box()
    assert box is not None
    assert 0 < x < box["width"]
    assert 0 < y < box["height"]
    return box["x"] + x, box["y"] + y


def _click_floor(page: Page, ahead: float, left: float) -> None:
    page.mouse.click(*_place(page, ahead, left))


def _entered(page: Page) -> tuple[float, float]:
    section = goal_section(page)
    return (
        float(section.get_by_label("Ahead (m)").input_value()),
        float(section.get_by_label("Left (m)").input_value()),
    )


def test_a_click_on_the_floor_sets_the_goal_with_every_camera(
    scene: Callable[..., Page], room: Server, eventually: Eventually, keep_picture: KeepPicture
) -> None:
    page = on_robots_tab(scene())
    eventually(lambda: _viewer(page).evaluate(_READY, _BASE), 20)
    # Nothing must move the robot here: clicks are compared with its position.
    room.api.post("/api/playback", json={"paused": True}).raise_for_status()
    page.wait_for_selector('html[data-freshness="held"]')
    section, words = goal_section(page), page.locator(".scene-pick")
    pick = section.get_by_role("button", name="Pick a goal")
    places = {"Free": (1.6, 0.3), "Follow": (2.0, -0.4), "Top-down": (1.2, 0.5)}
    for camera, place in places.items():
        page.get_by_role("radio", name=camera, exact=True).check(force=True)
        page.wait_for_timeout(1500)
        # Without "Pick a goal" a click has no effect.
        before = _entered(page)
        _click_floor(page, *place)
        page.wait_for_timeout(200)
        assert _entered(page) == before
        pick.click()
        expect(words).to_contain_text("Click the floor: the place is entered, but not sent.")
        if camera == "Follow":
            keep_picture(page, "goal-picking")
            assert findings(page) == []
        _click_floor(page, *place)
        eventually(lambda place=place: math.dist(_entered(page), place) < 0.06, 5)
        expect(words).to_contain_text("Entered but not sent: ")
        expect(pick).to_be_visible()
        expect(page.get_by_role("radio", name=camera, exact=True)).to_be_checked()
    # A press that turns the scene picks nothing; Esc cancels, and stops nothing with none armed.
    pick.click()
    box = page.locator("observer-scene iframe").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 200, box["y"] + 150)
    page.mouse.down()
    page.mouse.move(box["x"] + 240, box["y"] + 160, steps=4)
    page.mouse.up()
    expect(section.get_by_role("button", name="Cancel picking")).to_be_visible()
    page.keyboard.press("Escape")
    expect(pick).to_be_visible()
    expect(words).to_be_hidden()
    assert room.get("/robots")["stopped"] is None


def test_a_phone_shows_the_scene_for_picking_a_goal(
    scene: Callable[..., Page], eventually: Eventually, keep_picture: KeepPicture
) -> None:
    page = scene(viewport=_PHONE, has_touch=True)
    eventually(lambda: _viewer(page).evaluate(_READY, _BASE), 20)
    on_robots_tab(page)
    goal_section(page).get_by_role("button", name="Pick a goal").click()
    words = page.locator(".scene-pick")
    expect(words).to_contain_text("Click the floor")
    expect(page.locator("#stop-robots")).to_be_in_viewport()
    page.wait_for_timeout(1500)
    x, y = _place(page, 1.8, 0.2)
    page.touchscreen.tap(x, y)
    expect(words).to_contain_text(re.compile(r"Entered but not sent: 1\.\d\d m ahead"))
    expect(words.get_by_role("button", name="Cancel")).to_be_hidden()
    assert page.evaluate(TOO_WIDE) == []
    keep_picture(page, "phone-goal-picked")


def test_a_click_sends_an_armed_observer_immediately(
    scene: Callable[..., Page], room: Server, eventually: Eventually, keep_picture: KeepPicture
) -> None:
    page = on_robots_tab(scene())
    page.get_by_role("radio", name="Top-down").check(force=True)
    eventually(lambda: _viewer(page).evaluate(_READY, _BASE), 20)
    page.wait_for_timeout(1500)

    def send() -> None:
        goal_section(page).get_by_role("button", name="Pick a goal").click()
        _click_floor(page, 1.5, 0.4)

    until_driving(page, send)
    # The robot is moving, and its displayed position lags a little.
    assert math.dist(_entered(page), (1.5, 0.4)) < 0.25
    eventually(lambda: (room.get("/robots")["goal"] or {}).get("place"), 5)
    page.wait_for_timeout(1500)
    keep_picture(page, "goal-scene")
    # While a robot is armed, Esc stops it even while a goal is being picked.
    deadline = time.monotonic() + DRIVEN_S
    while room.get("/robots")["stopped"] is None:
        assert time.monotonic() < deadline
        if arm_observer(page):
            goal_section(page).get_by_role("button", name="Pick a goal").click()
            page.keyboard.press("Escape")
            page.wait_for_timeout(500)
    expect(page.locator(".scene-pick")).to_be_hidden()
    expect(goal_section(page).locator(".missing")).to_contain_text("reset the stop first")


def _colour(pixels: Pixels, page: Page, ahead: float, left: float) -> tuple[float, ...]:
    """Return the mean colour around a place on the floor as displayed: blue, green, red."""
    x, y = _viewer(page).evaluate(_PLACE, [_BASE, ahead, left])
    scene = pixels(page.locator("observer-scene iframe"))
    around = scene[round(y) - 4 : round(y) + 5, round(x) - 4 : round(x) + 5]
    return tuple(around.reshape(-1, 3).mean(axis=0).tolist())


def test_the_local_map_is_drawn_where_the_robot_saw_free_floor(
    scene: Callable[..., Page], room: Server, pixels: Pixels, keep_picture: KeepPicture
) -> None:
    page = on_robots_tab(scene())
    page.get_by_role("radio", name="Top-down").check(force=True)
    layers = page.locator("#scene-layers")
    box = layers.get_by_label("Local map")
    expect(box).to_be_checked()
    for other in ("Point cloud", "Boxes", "Arrows", "Trails", "Guard zones", "Path"):
        layers.get_by_label(other).uncheck(force=True)
    send = goal_section(page).get_by_role("button", name="Drive there")
    deadline = time.monotonic() + DRIVEN_S
    # The last second of a drive stays visible while the playback is paused.
    while not _viewer(page).evaluate(_READY, _MAP):
        assert time.monotonic() < deadline
        if arm_observer(page):
            send.click()
        page.wait_for_timeout(200)
    room.api.post("/api/playback", json={"paused": True}).raise_for_status()
    page.wait_for_timeout(1500)
    keep_picture(page, "local-map")
    seen = 1.8, 0.0
    blue, green, red = _colour(pixels, page, *seen)
    assert green > max(blue, red) + 8
    # Outside the field of view it is unknown.
    unknown = _colour(pixels, page, 0.7, 0.8)
    assert max(unknown) - min(unknown) < 8
    assert findings(page) == []
    box.uncheck(force=True)
    page.wait_for_timeout(800)
    hidden = _colour(pixels, page, *seen)
    assert max(hidden) - min(hidden) < 8
