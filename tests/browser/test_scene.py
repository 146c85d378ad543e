"""The 3D scene as each user sets it: layers, camera, and enlarging it to the whole window."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, Frame, Page, ViewportSize, expect

from .conftest import Eventually, KeepPicture, OpenPanel, Server

# Small enough to be drawn in software several times a second.
_SMALL: ViewportSize = {"width": 900, "height": 600}

_SHOWN = """(node) => {
  const entry = window.__viserSceneTree?.getState()[node];
  return entry ? entry.effectiveVisibility : null;
}"""
# Eye and viewing direction in the display's axes: ahead, left, up.
_LOOK = """() => {
  const { camera } = window.__viserMutable;
  const { elements: e } = camera.matrixWorld;
  return [[e[12], e[13], e[14]], [-e[8], -e[9], -e[10]], [e[4], e[5], e[6]]];
}"""
_NO_WEBGL = """{
  const { getContext } = HTMLCanvasElement.prototype;
  HTMLCanvasElement.prototype.getContext = function (kind, ...options) {
    return kind.startsWith("webgl") ? null : getContext.call(this, kind, ...options);
  };
}"""
_DISPLAY = """() => [...window.__viserMutable.nodeRefFromName["/display"].matrixWorld.elements]"""
# Turn robot and world a quarter turn to the left, as if sent by the server.
_TURN = """() => {
  const { messageQueue, requestRender, nodePoseData } = window.__viserMutable;
  const name = "/display/world";
  const [w, x, y, z] = nodePoseData[name].wxyz.map((value) => value * Math.SQRT1_2);
  const wxyz = [w - z, x - y, y + x, z + w];
  messageQueue.push({ type: "SetOrientationMessage", name, owner: "", wxyz });
  requestRender();
}"""
# Remove a node, as if sent by the server.
_REMOVE = """(name) => {
  const { messageQueue, requestRender } = window.__viserMutable;
  window.removed = (window.removed ?? 0) + 1;
  messageQueue.push({ type: "RemoveSceneNodeMessage", name, owner: "" });
  requestRender();
}"""
# The server closes the connection on this message.
_INVALID_POSE = """() => window.__viserMutable.sendMessage({ type: "ViewerCameraMessage" })"""


def _found(page: Page) -> Frame | None:
    # Playwright learns of frames only while it is handling a call.
    page.evaluate("0")
    return page.frame(url=re.compile("/viewer/"))


def _viewer(page: Page) -> Frame:
    frame = _found(page)
    assert frame is not None
    return frame


def _shown(page: Page, layer: str) -> bool | None:
    """Return whether a node is shown; None: it does not exist or the scene is not loaded yet."""
    frame = _found(page)
    if frame is None:
        return None
    shown: bool | None = frame.evaluate(_SHOWN, f"/display/world/{layer}")
    return shown


def _look(page: Page) -> Any:
    """Return eye, direction and up vector of the picture, (3, 3), in the display's axes."""
    eye, ahead, up = np.array(_viewer(page).evaluate(_LOOK))
    T = np.array(_viewer(page).evaluate(_DISPLAY)).reshape(4, 4).T
    rotation = T[:3, :3]
    return np.stack([rotation.T @ (eye - T[:3, 3]), rotation.T @ ahead, rotation.T @ up])


def _heading(page: Page) -> float:
    """Return the horizontal viewing direction, rad to the left."""
    _, ahead, _ = _look(page)
    return float(np.arctan2(ahead[1], ahead[0]))


def _apart(a: float, b: float) -> float:
    return float(np.angle(np.exp(1j * (a - b))))


@pytest.fixture
def open_scene(
    server: Server, open_panel: OpenPanel, wait_for_scene: Callable[[Page], None]
) -> Iterator[Callable[..., Page]]:
    def open_one(**options: Any) -> Page:
        page = open_panel(viewer=True, **{"viewport": _SMALL, **options})
        wait_for_scene(page)
        expect(page.locator(".scene-tools")).to_be_visible()
        return page

    yield open_one
    server.api.post("/api/playback", json={"paused": False}).raise_for_status()


def _layer(page: Page, name: str) -> Any:
    return page.locator(f"input[name=layer][value={name}]")


def test_two_users_hide_different_layers(
    open_scene: Callable[..., Page], eventually: Eventually
) -> None:
    one, two = open_scene(), open_scene()
    _layer(one, "cloud").uncheck(force=True)
    _layer(two, "boxes").uncheck(force=True)
    eventually(lambda: _shown(one, "cloud") is False and _shown(two, "boxes") is False)
    # The label belongs to the box.
    assert _shown(two, "boxes/label_0") is False
    assert _shown(one, "cloud/points") is False
    for page, layers in ((one, ("boxes", "arrows", "trails")), (two, ("cloud", "truth"))):
        assert all(_shown(page, layer) for layer in layers)
    # It also applies to the next page in the same browser.
    two.close()
    one.reload()
    eventually(lambda: _shown(one, "boxes"), 30)
    eventually(lambda: _shown(one, "cloud") is False, 30)
    expect(_layer(one, "cloud")).not_to_be_checked()
    expect(_layer(one, "boxes")).to_be_checked()
    _layer(one, "cloud").check(force=True)
    eventually(lambda: _shown(one, "cloud"), 30)


def test_a_lost_connection_is_restored_without_reloading_the_scene(
    open_scene: Callable[..., Page], eventually: Eventually
) -> None:
    page = open_scene()
    _layer(page, "boxes").uncheck(force=True)
    eventually(lambda: _shown(page, "boxes") is False)
    viewer = _viewer(page)
    # The server sends this only on a new connection.
    viewer.evaluate(_REMOVE, "/display/world/truth")
    eventually(lambda: _shown(page, "truth") is None)
    viewer.evaluate(_INVALID_POSE)
    eventually(lambda: _shown(page, "truth"))
    eventually(lambda: _shown(page, "boxes") is False)
    assert viewer.evaluate("window.removed") == 1


def test_the_legend_has_the_colours_of_the_scene(
    server: Server, open_scene: Callable[..., Page], keep_picture: KeepPicture
) -> None:
    page = open_scene(viewport={"width": 1440, "height": 900})
    layers = server.get("/scene")["layers"]
    shown = page.locator(".scene-layers label")
    assert shown.all_inner_texts() == [layer["title"] for layer in layers]
    for label, layer in zip(shown.all(), layers, strict=True):
        image = label.locator(".swatch").evaluate("e => getComputedStyle(e).backgroundImage")
        for red, green, blue in layer["colors"]:
            assert f"rgb({red}, {green}, {blue})" in image
    keep_picture(page, "scene-legend")


def test_the_camera_follows_until_the_user_moves_it(
    server: Server,
    open_scene: Callable[..., Page],
    eventually: Eventually,
    keep_picture: KeepPicture,
) -> None:
    page = open_scene()
    # Only the test moves the robot here.
    server.api.post("/api/playback", json={"paused": True}).raise_for_status()
    page.wait_for_selector('html[data-freshness="held"]')
    follow = page.get_by_role("radio", name="Follow", exact=True)
    follow.check(force=True)
    page.wait_for_timeout(1000)
    before = _heading(page)
    _viewer(page).evaluate(_TURN)
    eventually(lambda: abs(_apart(_heading(page), before + np.pi / 2)) < 0.05, 15)

    page.get_by_role("radio", name="Top-down").check(force=True)
    eventually(lambda: _look(page)[1][2] < -0.99)
    # The initial heading is up in the picture, though the robot has turned.
    assert _look(page)[2][0] > 0.99
    assert _look(page)[0][2] > 5
    keep_picture(page, "scene-top-down")

    scene = page.locator("observer-scene iframe").bounding_box()
    assert scene is not None
    middle = (scene["x"] + scene["width"] / 2, scene["y"] + scene["height"] / 2)
    page.mouse.move(*middle)
    page.mouse.down()
    page.mouse.move(middle[0] + 60, middle[1] - 40, steps=4)
    page.mouse.up()
    expect(page.get_by_role("radio", name="Free")).to_be_checked()
    page.get_by_role("button", name="Reset view").click()
    eventually(lambda: abs(_apart(_heading(page), before + np.pi / 2)) < 0.05)
    follow.check(force=True)
    page.mouse.move(*middle)
    page.mouse.wheel(0, 200)
    expect(page.get_by_role("radio", name="Free")).to_be_checked()


def test_scene_and_views_enlarge_to_the_window_and_esc_returns(
    open_scene: Callable[..., Page], keep_picture: KeepPicture, eventually: Eventually
) -> None:
    page = open_scene()
    stage = page.locator(".stage")
    before = stage.bounding_box()
    button = page.get_by_role("button", name="Enlarge the 3D scene")
    button.click()
    box = stage.bounding_box()
    assert box is not None
    assert box["width"] == _SMALL["width"]
    assert box["y"] + box["height"] == _SMALL["height"]
    assert box["y"] < 200
    expect(page.locator("#stop-robots")).to_be_in_viewport()
    expect(page.locator(".headline-text")).to_be_in_viewport()
    expect(page.locator("observer-speed-chart")).not_to_be_visible()
    expect(page.locator("observer-playback")).to_be_in_viewport()
    keep_picture(page, "scene-enlarged")
    # Also from within the viewer's frame.
    page.locator("observer-scene iframe").focus()
    page.keyboard.press("Escape")
    expect(button).to_be_visible()
    assert stage.bounding_box() == before

    view = page.locator('observer-live-view[data-view="left"]')
    larger = view.get_by_role("button", name="Enlarge")
    larger.hover()
    scrolled = page.locator("main").evaluate("e => e.scrollTop")
    larger.click()
    image = view.locator(".view-image").bounding_box()
    assert image is not None
    assert image["width"] > 0.6 * _SMALL["width"]
    assert image["y"] + image["height"] <= _SMALL["height"]
    view.locator(".pixel-pick").click(position={"x": 40, "y": image["height"] - 30})
    expect(view.locator(".answer")).to_be_visible()
    # Escape closes first the answer, then the enlarged view.
    page.keyboard.press("Escape")
    expect(view.locator(".answer")).to_be_hidden()
    expect(view).to_have_attribute("data-enlarged", "")
    page.keyboard.press("Escape")
    expect(larger).to_be_visible()
    eventually(lambda: abs(page.locator("main").evaluate("e => e.scrollTop") - scrolled) < 2)
    # A view that replaces the live parts is not covered by an enlarged one.
    button.click()
    page.evaluate("location.hash = '#runs'")
    expect(page.locator("body")).not_to_have_attribute("data-enlarged", re.compile(".*"))


def test_stop_works_while_the_scene_is_loading(
    open_panel: OpenPanel, wait_for_scene: Callable[[Page], None]
) -> None:
    """Without a graphics card compiling its shaders takes seconds."""
    page = open_panel(viewer=True, viewport=_SMALL)
    sent: list[float] = []
    page.on(
        "request",
        lambda each: sent.append(time.monotonic()) if each.url.endswith("/robots/stop") else None,
    )
    box = page.locator("#stop-robots").bounding_box()
    assert box is not None
    took: list[float] = []
    until = time.monotonic() + 8
    while (pressed := time.monotonic()) < until:
        before = len(sent)
        page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        while len(sent) == before:
            assert time.monotonic() < pressed + 5, f"not sent within 5 s; others after {took}"
            page.wait_for_timeout(5)
        took.append(sent[-1] - pressed)
        page.wait_for_timeout(200)
    wait_for_scene(page)
    assert max(took) < 1.0, took


def test_stop_keys_work_inside_the_scene(
    open_scene: Callable[..., Page], server: Server, eventually: Eventually
) -> None:
    page = open_scene()
    eventually(lambda: server.get("/robots"))
    for key in ("Space", "Escape"):
        page.locator("observer-scene iframe").focus()
        with page.expect_request("**/api/robots/stop", timeout=5000):
            page.keyboard.press(key)


def test_the_scene_shows_loading_until_something_is_drawn(
    open_panel: OpenPanel, wait_for_scene: Callable[[Page], None], keep_picture: KeepPicture
) -> None:
    page = open_panel(viewer=True, viewport=_SMALL)
    loading = page.get_by_text("Loading the 3D scene")
    expect(loading).to_be_visible()
    keep_picture(page, "scene-loading")
    wait_for_scene(page)
    expect(loading).not_to_be_visible(timeout=20_000)


def test_a_browser_without_webgl_says_so(
    browser: Browser, server: Server, keep_picture: KeepPicture
) -> None:
    # Not by open_panel, as viser's client is expected to fail.
    page = browser.new_page(viewport=_SMALL)
    page.add_init_script(_NO_WEBGL)
    page.goto(server.link)
    expect(page.locator(".scene-trouble")).to_contain_text("it has no WebGL 2")
    expect(page.get_by_text("Loading the 3D scene")).not_to_be_visible()
    expect(page.locator(".scene-tools")).not_to_be_visible()
    expect(page.locator("observer-obstacles tbody tr").first).to_be_visible(timeout=20_000)
    keep_picture(page, "scene-without-webgl")
    page.context.close()


def test_a_missing_viewer_shows_only_its_reason(
    server: Server, browser: Browser, keep_picture: KeepPicture
) -> None:
    page = browser.new_page()
    refusal = "<p>The 3D view is unavailable: the 3D viewer could not be started: no port.</p>"
    page.route(
        "**/viewer/",
        lambda route: route.fulfill(status=503, content_type="text/html", body=refusal),
    )
    page.goto(server.link)
    frame = page.frame_locator("observer-scene iframe")
    expect(frame.locator("p")).to_contain_text("no port", timeout=20_000)
    expect(page.get_by_text("Loading the 3D scene")).not_to_be_visible()
    expect(page.locator(".scene-tools")).not_to_be_visible()
    keep_picture(page, "scene-without-viewer")
    page.context.close()


def test_layers_are_a_list_in_a_narrow_window(
    open_scene: Callable[..., Page], keep_picture: KeepPicture
) -> None:
    page = open_scene(viewport={"width": 360, "height": 780}, has_touch=True)
    box = _layer(page, "cloud")
    expect(box).not_to_be_visible()
    page.get_by_role("button", name="Layers").click()
    page.locator(".scene-layers label").first.click()
    expect(box).not_to_be_checked()
    keep_picture(page, "scene-phone")
    for control in page.locator(".scene-tools > *").all():
        place = control.bounding_box()
        assert place is not None
        assert place["x"] >= 0
        assert place["x"] + place["width"] <= 360
