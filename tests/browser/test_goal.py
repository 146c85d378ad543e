"""Sending the observer to a goal on the page: typed, and by a click on the floor of the scene.

The observer is that of a simulated room, driven by the very way of a real one.
"""

from __future__ import annotations

import contextlib
import math
import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Error, Frame, Locator, Page, ViewportSize, expect

from .axe import findings
from .conftest import TOO_WIDE, Eventually, KeepPicture, OpenPanel, Pixels, Server
from .witness import Witness

# Drawn and looked at in time on slow machines too, where frames would come late and end the drive.
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
# Somebody goes to and fro across the way to a goal.
_CROSSING = """\
based_on: drive
title: A room with somebody in the way
help: A P3-DX goes to and fro in front of the observer.
camera: {width: 320, height: 160}
robots:
  - name: P3-DX
    x: 2.3
    y: 0.9
    heading_deg: -90
    size: [0.455, 0.381, 0.33]
    motion:
      kind: course
      after: back
      acceleration: 0.8
      legs:
        - {kind: drive, distance_m: 1.8, speed: 0.5}
texture: {robot: red}
"""
_RATE = 0.6
_DRIVEN_S = 90.0
# So small that the processor draws several times a second, with the panel beside the scene.
_SMALL: ViewportSize = {"width": 980, "height": 620}
_WIDE: ViewportSize = {"width": 1440, "height": 900}
_PHONE: ViewportSize = {"width": 390, "height": 844}
_NARROWEST = 360
_BASE = "/display/world/base"
_MAP = "/display/world/map/cells"
# Have the page hear of this goal, as if the server had told of it.
_TELL = """{
  const { parse } = JSON;
  JSON.parse = (text, ...more) => {
    const message = parse(text, ...more);
    if (message?.type === "robots" && window.toldGoal) message.goal = window.toldGoal;
    return message;
  };
}"""
_TOLD = {
    "state": "driving",
    "sentence": "Passing behind obstacle 3.",
    "place": [2.3, -0.4],
    "distance_m": 2.33,
    "elapsed_s": 67.9,
    "path": [],
    "risk_per_metre": 0.001,
    "planned_risk_per_metre": 0.0002,
    "waits_for": 3,
    "meets_s": 1.4,
    "meets_at": [0.9, 0.1],
    "refused": [
        {
            "direction": 0.0, "speed_mps": 0.5, "path": [[0.1, 0.0], [2.0, 0.0]], "cause": "risk",
            "risk": 0.0412, "track": 3, "meets_s": 1.4, "guard": None,
        },
        {
            "direction": 0.79, "speed_mps": 0.3, "path": [[0.1, 0.0], [1.0, 1.0]],
            "cause": "guard", "risk": None, "track": None, "meets_s": None,
            "guard": "obstacle 2 is within the stopping distance",
        },
    ],
}  # fmt: skip
# Where a place seen from the robot is in the frame's window, px, by the viewer's own camera.
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
def room_source(tmp_path_factory: pytest.TempPathFactory) -> str:
    scenario = tmp_path_factory.mktemp("room") / "room.yaml"
    scenario.write_text(_ROOM)
    return f"simulated:{scenario}"


@pytest.fixture(scope="module")
def room(server: Server, room_source: str) -> Iterator[Server]:
    _open(server, room_source)
    server.api.post("/api/playback", json={"rate": _RATE}).raise_for_status()
    yield server
    server.api.delete("/api/goal")
    server.api.post("/api/robots/stop").raise_for_status()
    server.api.post("/api/robots/reset").raise_for_status()
    _open(server, "simulated:lab")
    server.api.post("/api/playback", json={"rate": 1.0}).raise_for_status()


@pytest.fixture(autouse=True)
def _begin_at_rest(room: Server) -> None:
    room.api.post("/api/robots/stop").raise_for_status()
    room.api.post("/api/robots/reset").raise_for_status()


def _open(server: Server, source: str) -> None:
    """Open it; the engine may be starting."""
    deadline = time.monotonic() + 60.0
    while not server.api.put("/api/source", json={"source": source}).is_success:
        assert time.monotonic() < deadline, source
        time.sleep(1.0)


def _section(page: Page) -> Locator:
    return page.locator("observer-goal")


def _on_robots_tab(page: Page) -> Page:
    page.get_by_role("tab", name="Robots").click()
    page.locator("input[name=drive-role][value=observer]").check(force=True)
    expect(_section(page).get_by_role("heading", name="Drive to a goal")).to_be_visible()
    return page


def _arm(page: Page) -> bool:
    """Arm the observer if it is not; return whether a goal can be sent."""
    arm = page.get_by_role("button", name="Arm", exact=True)
    if arm.is_visible() and arm.is_enabled():
        # Unless it changes meanwhile.
        with contextlib.suppress(Error):
            arm.click(timeout=2000)
        page.wait_for_timeout(300)
    return _section(page).get_by_role("button", name="Drive there").is_enabled()


def _until_driving(page: Page, send: Callable[[], object]) -> None:
    """Send it until it drives to the goal.

    A busy machine shows a frame too late now and then: that ends the drive, and it is sent again.
    """
    deadline = time.monotonic() + _DRIVEN_S
    giving_up = _section(page).get_by_role("button", name="Give up goal")
    while time.monotonic() < deadline:
        if not giving_up.is_visible() and _arm(page):
            send()
            page.wait_for_timeout(300)
        if giving_up.is_visible():
            return
    pytest.fail(f"it was not sent: {_section(page).inner_text()}")


def test_the_observer_drives_to_a_typed_goal_until_it_is_given_up(
    room: Server, open_panel: OpenPanel, eventually: Eventually, keep_picture: KeepPicture
) -> None:
    page = _on_robots_tab(open_panel(refusals=True))
    section = _section(page)
    send = section.get_by_role("button", name="Drive there")
    expect(send).to_be_disabled()
    expect(section.locator(".missing")).to_have_text("First arm the observer.")
    keep_picture(page, "goal-unarmed")
    # By keyboard: Enter in a field sends.
    ahead, error = section.get_by_label("Ahead (m)"), section.locator("#goal-error")
    ahead.fill("")

    def refused() -> str:
        if _arm(page):
            ahead.press("Enter")
        return error.inner_text()

    eventually(refused, 30)
    expect(error).to_contain_text("Not sent: enter both distances")
    expect(ahead).to_have_attribute("aria-invalid", "true")
    ahead.fill("3")

    driving, ended = section.locator(".goal-driving"), section.locator(".goal-ended")
    deadline = time.monotonic() + _DRIVEN_S
    told = ""
    with Witness(room, "observer") as witness:
        while ended.inner_text() != "The goal was given up.":
            assert time.monotonic() < deadline, section.inner_text()
            _until_driving(page, lambda: ahead.press("Enter"))
            if witness.first(True, time.monotonic(), 3.0) is None:
                continue
            told = f"{driving.inner_text()}\n{page.locator('.robot-why').inner_text()}"
            keep_picture(page, "goal-driving")
            start = time.monotonic()
            # Unless it ended by itself meanwhile.
            with contextlib.suppress(Error):
                driving.get_by_role("button", name="Give up goal").click(timeout=2000)
            witness.zero_after(start)
            page.wait_for_timeout(300)
    expect(driving).to_be_hidden()
    # The keyboard's place is not lost with the button.
    expect(ahead).to_be_focused()
    assert re.search(r"\d m left · \d:\d\d", told)
    assert "Driving to a goal by itself." in told
    goal = room.get("/robots")["goal"]
    assert goal["state"] == "ended"
    assert goal["risk_per_metre"] == pytest.approx(0.001)


def test_a_page_that_is_left_ends_the_drive(
    room: Server,
    open_panel: OpenPanel,
    hide_page: Callable[[Page, bool], None],
    eventually: Eventually,
) -> None:
    page = _on_robots_tab(open_panel(refusals=True))
    _until_driving(page, _section(page).get_by_role("button", name="Drive there").click)
    hide_page(page, True)
    eventually(lambda: room.get("/robots")["goal"]["state"] == "ended", 3)
    hide_page(page, False)
    expect(_section(page).locator(".goal-ended")).to_contain_text("given up: ")


def test_the_risk_of_a_goal_is_the_parameter_unless_another_is_chosen(
    room: Server, open_panel: OpenPanel
) -> None:
    page = _on_robots_tab(open_panel())
    risk = _section(page).locator("#goal-risk")
    usual = risk.locator("option").first
    expect(usual).to_have_text("0.001 – default")
    name = "navigation.risk_per_metre"
    try:
        room.api.patch("/api/parameters", json={name: 0.005}).raise_for_status()
        expect(usual).to_have_text("0.005 – default")
        expect(risk).to_have_value("")
    finally:
        room.api.patch("/api/parameters", json={name: 0.001}).raise_for_status()


@pytest.mark.parametrize("look", ["light", "dark", "phone"])
def test_every_state_of_a_goal_is_told_to_everybody(
    open_panel: OpenPanel, keep_picture: KeepPicture, look: str
) -> None:
    options: Any = (
        {"viewport": _PHONE, "has_touch": True} if look == "phone" else {"color_scheme": look}
    )
    page = _on_robots_tab(open_panel(script=_TELL, **options))
    section = _section(page)
    section.get_by_text("Advanced").click()
    driving, ended = section.locator(".goal-driving"), section.locator(".goal-ended")

    def check(state: str, **changes: Any) -> None:
        page.evaluate("(goal) => { window.toldGoal = goal; }", {**_TOLD, "state": state, **changes})
        expect(driving).to_be_visible(visible=state == "driving")
        expect(ended).to_be_visible(visible=state != "driving")
        section.locator("h3").scroll_into_view_if_needed()
        assert findings(page) == []
        keep_picture(page, f"goal-{state}-{look}")
        if look == "phone":
            page.set_viewport_size({**_PHONE, "width": _NARROWEST})
            assert page.evaluate(TOO_WIDE) == []
            page.set_viewport_size(_PHONE)

    check("driving")
    expect(driving).to_contain_text("Passing behind obstacle 3.")
    expect(driving).to_contain_text("2.33 m left · 1:08")
    expect(section.locator("[role=status].visually-hidden")).to_have_text(
        "Passing behind obstacle 3."
    )
    why, refused = driving.locator("observer-goal-why"), driving.locator(".refused-paths li")
    expect(why).to_be_hidden()
    # By keyboard, after the button above it.
    driving.get_by_role("button", name="Give up goal").focus()
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    expect(why).to_contain_text("obstacle 3: on the straight path they would meet in 1.4 s")
    expect(why).to_contain_text("0.001 accepted, 0.0002 planned")
    expect(refused).to_have_text(
        [
            "Left by 45° at 0.3 m/s: refused by the guard, obstacle 2 is within the stopping "
            "distance.",
            "Straight on at 0.5 m/s: would meet obstacle 3 in 1.4 s (risk per metre 0.04).",
        ]
    )
    check("driving", sentence="Waiting for obstacle 3: it would cross in 1.4 s.")
    refused.last.scroll_into_view_if_needed()
    keep_picture(page, f"goal-why-{look}")
    check("driving", refused=[], waits_for=None)
    expect(why).to_contain_text("no obstacle")
    expect(why).to_contain_text("No path was refused.")
    check("ended", sentence="The goal was given up: the robot reports no odometry any more.")
    expect(ended).to_contain_text("no odometry any more")
    check("reached", sentence="The goal is reached.")


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
    # Playwright hears of frames only while it is asked something.
    page.evaluate("0")
    frame = page.frame(url=re.compile("/viewer/"))
    assert frame is not None
    return frame


def _place(page: Page, ahead: float, left: float) -> tuple[float, float]:
    """Where a place seen from the robot is drawn in the page, px."""
    x, y = _viewer(page).evaluate(_PLACE, [_BASE, ahead, left])
    box = page.locator("observer-scene iframe").bounding_box()
    assert box is not None
    assert 0 < x < box["width"]
    assert 0 < y < box["height"]
    return box["x"] + x, box["y"] + y


def _click_floor(page: Page, ahead: float, left: float) -> None:
    page.mouse.click(*_place(page, ahead, left))


def _entered(page: Page) -> tuple[float, float]:
    section = _section(page)
    return (
        float(section.get_by_label("Ahead (m)").input_value()),
        float(section.get_by_label("Left (m)").input_value()),
    )


def test_a_click_on_the_floor_is_the_goal_from_every_camera(
    scene: Callable[..., Page], room: Server, eventually: Eventually, keep_picture: KeepPicture
) -> None:
    page = _on_robots_tab(scene())
    eventually(lambda: _viewer(page).evaluate(_READY, _BASE), 20)
    # What moves the robot here is nobody: clicks are compared with where it stands.
    room.api.post("/api/playback", json={"paused": True}).raise_for_status()
    page.wait_for_selector('html[data-freshness="held"]')
    section, words = _section(page), page.locator(".scene-pick")
    pick = section.get_by_role("button", name="Pick a goal")
    places = {"Free": (1.6, 0.3), "Follow": (2.0, -0.4), "Top-down": (1.2, 0.5)}
    for camera, place in places.items():
        page.get_by_role("radio", name=camera, exact=True).check(force=True)
        page.wait_for_timeout(1500)
        # Without "Pick a goal" a click is none.
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
        expect(words).to_contain_text("Entered, not sent: ")
        expect(pick).to_be_visible()
        expect(page.get_by_role("radio", name=camera, exact=True)).to_be_checked()
    # A press that turns the scene picks nothing; Esc ends it, and stops nobody where none is armed.
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


def test_on_a_phone_the_scene_comes_up_for_the_click(
    scene: Callable[..., Page], eventually: Eventually, keep_picture: KeepPicture
) -> None:
    page = scene(viewport=_PHONE, has_touch=True)
    eventually(lambda: _viewer(page).evaluate(_READY, _BASE), 20)
    _on_robots_tab(page)
    _section(page).get_by_role("button", name="Pick a goal").click()
    words = page.locator(".scene-pick")
    expect(words).to_contain_text("Click the floor")
    expect(page.locator("#stop-robots")).to_be_in_viewport()
    page.wait_for_timeout(1500)
    x, y = _place(page, 1.8, 0.2)
    page.touchscreen.tap(x, y)
    expect(words).to_contain_text(re.compile(r"Entered, not sent: 1\.\d\d m ahead"))
    expect(words.get_by_role("button", name="Cancel")).to_be_hidden()
    assert page.evaluate(TOO_WIDE) == []
    keep_picture(page, "phone-goal-picked")


def test_an_armed_observer_is_sent_by_the_click_at_once(
    scene: Callable[..., Page], room: Server, eventually: Eventually, keep_picture: KeepPicture
) -> None:
    page = _on_robots_tab(scene())
    page.get_by_role("radio", name="Top-down").check(force=True)
    eventually(lambda: _viewer(page).evaluate(_READY, _BASE), 20)
    page.wait_for_timeout(1500)

    def send() -> None:
        _section(page).get_by_role("button", name="Pick a goal").click()
        _click_floor(page, 1.5, 0.4)

    _until_driving(page, send)
    # The robot that moves meanwhile is seen a little later than it is.
    assert math.dist(_entered(page), (1.5, 0.4)) < 0.25
    eventually(lambda: (room.get("/robots")["goal"] or {}).get("place"), 5)
    page.wait_for_timeout(1500)
    keep_picture(page, "goal-scene")
    # While a robot is armed, Esc stops also where a goal is being picked.
    deadline = time.monotonic() + _DRIVEN_S
    while room.get("/robots")["stopped"] is None:
        assert time.monotonic() < deadline
        if _arm(page):
            _section(page).get_by_role("button", name="Pick a goal").click()
            page.keyboard.press("Escape")
            page.wait_for_timeout(500)
    expect(page.locator(".scene-pick")).to_be_hidden()
    expect(_section(page).locator(".missing")).to_contain_text("reset the stop first")


def _colour(pixels: Pixels, page: Page, ahead: float, left: float) -> tuple[float, ...]:
    """Mean colour around a place on the floor as it is seen, blue, green and red."""
    x, y = _viewer(page).evaluate(_PLACE, [_BASE, ahead, left])
    scene = pixels(page.locator("observer-scene iframe"))
    around = scene[round(y) - 4 : round(y) + 5, round(x) - 4 : round(x) + 5]
    return tuple(around.reshape(-1, 3).mean(axis=0).tolist())


def test_the_local_map_is_seen_where_the_robot_saw_free_floor(
    scene: Callable[..., Page], room: Server, pixels: Pixels, keep_picture: KeepPicture
) -> None:
    page = _on_robots_tab(scene())
    page.get_by_role("radio", name="Top-down").check(force=True)
    layers = page.locator("#scene-layers")
    box = layers.get_by_label("Local map")
    expect(box).to_be_checked()
    for other in ("Point cloud", "Boxes", "Arrows", "Trails", "Guard zones", "Path"):
        layers.get_by_label(other).uncheck(force=True)
    send = _section(page).get_by_role("button", name="Drive there")
    deadline = time.monotonic() + _DRIVEN_S
    # What is seen in the last second of a drive stays while the playback is paused.
    while not _viewer(page).evaluate(_READY, _MAP):
        assert time.monotonic() < deadline
        if _arm(page):
            send.click()
        page.wait_for_timeout(200)
    room.api.post("/api/playback", json={"paused": True}).raise_for_status()
    page.wait_for_timeout(1500)
    keep_picture(page, "local-map")
    seen = 1.8, 0.0
    blue, green, red = _colour(pixels, page, *seen)
    assert green > max(blue, red) + 8
    # Beside the view it is unknown.
    unknown = _colour(pixels, page, 0.7, 0.8)
    assert max(unknown) - min(unknown) < 8
    assert findings(page) == []
    box.uncheck(force=True)
    page.wait_for_timeout(800)
    hidden = _colour(pixels, page, *seen)
    assert max(hidden) - min(hidden) < 8


@pytest.fixture
def crossing(room: Server, room_source: str, tmp_path: Path) -> Iterator[Server]:
    """Somebody is in the way; other tests find their room again."""
    scenario = tmp_path / "crossing.yaml"
    scenario.write_text(_CROSSING)
    _open(room, f"simulated:{scenario}")
    yield room
    run = room.get("/status")["run"]
    if run:
        room.api.post(f"/api/runs/{run['id']}/stop")
    for kept in room.get("/history")["runs"]:
        room.api.delete(f"/api/runs/{kept['id']}")
    room.api.delete("/api/goal")
    _open(room, room_source)


def test_whoever_is_in_the_way_is_told_of_live_and_in_the_run(
    crossing: Server, open_panel: OpenPanel, keep_picture: KeepPicture
) -> None:
    page = _on_robots_tab(open_panel(refusals=True, viewport=_SMALL))
    section = _section(page)
    section.get_by_label("Ahead (m)").fill("4.5")
    send = section.get_by_role("button", name="Drive there")
    # Open before it is sent anywhere: a slow machine drives for moments only.
    section.locator("details", has=page.locator("observer-goal-why")).evaluate("e => e.open = true")
    run = crossing.api.post("/api/runs", json={"record": "none"}).json()["id"]
    refused = section.locator(".refused-paths li")
    deadline = time.monotonic() + _DRIVEN_S
    while not refused.first.is_visible():
        assert time.monotonic() < deadline, section.inner_text()
        _until_driving(page, send.click)
        page.wait_for_timeout(100)
    keep_picture(page, "goal-refused")
    crossing.api.post("/api/robots/stop").raise_for_status()
    crossing.api.post(f"/api/runs/{run}/stop").raise_for_status()

    page.set_viewport_size(_WIDE)
    page.evaluate("(run) => { location.hash = `#history/${run}`; }", run)
    told, slider = page.locator("observer-run-goal"), page.locator("#player-frame")
    expect(slider).to_be_enabled(timeout=60_000)
    frames = crossing.get(f"/runs/{run}/frames")["frames"]
    expect(told).to_contain_text("s: no goal.")
    goals = {at: entry["goal"] for at, entry in enumerate(frames) if entry["goal"]}
    at, goal = next((at, goal) for at, goal in goals.items() if goal["refused"])
    slider.fill(str(at))
    expect(told).to_contain_text(f"s: {goal['sentence']}")
    expect(told.locator(".refused-paths li")).to_have_count(len(goal["refused"]))
    expect(told).to_contain_text("0.001 accepted")
    told.scroll_into_view_if_needed()
    assert findings(page) == []
    keep_picture(page, "goal-run")
    # The same for the second that is read in the chart.
    slider.fill("0")
    expect(told).to_contain_text("s: no goal.")
    chart = page.locator("observer-run-chart .chart")
    chart.focus()
    for _ in range(60):
        page.keyboard.press("ArrowRight")
        if told.locator(".refused-paths li").first.is_visible():
            break
    expect(told.locator(".refused-paths li").first).to_contain_text("m/s: ")
