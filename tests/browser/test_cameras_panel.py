"""Cameras in the panel: connected ones, uncalibrated ones, network cameras.

The devices are faked at the REST interface, as test machines have no cameras.
"""

from __future__ import annotations

import importlib.util
import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from observer.sources.cameras.spec import parse_devices

from .conftest import Json, KeepPicture, OpenPanel, Server

pytestmark = pytest.mark.usefixtures("lab_before_and_after")

Picker = Callable[..., tuple[Page, list[str], Json]]
_PORTS = ["/dev/v4l/by-path/pci-0000:00:14.0-usb-0:1:1.0-video-index0",
          "/dev/v4l/by-path/pci-0000:00:14.0-usb-0:2:1.0-video-index0"]  # fmt: skip
_BUSY = "/dev/video4 is in use by another program; close it there, or choose another camera"
_SHARED = "Both cameras share one USB bus; with YUYV at 640x480 and 30 images/s it is too slow"


def _device(number: int, **changed: Any) -> Json:
    modes = [
        {"pixel_format": "YUYV", "width": 640, "height": 480, "rates": [30.0, 15.0]},
        {"pixel_format": "MJPG", "width": 640, "height": 480, "rates": [30.0]},
        {"pixel_format": "MJPG", "width": 1280, "height": 720, "rates": [60.0, 30.0]},
    ]
    device = {
        "path": f"/dev/video{2 * number}",
        "by_path": _PORTS[number] if number < len(_PORTS) else None,
        "card": "HD Webcam",
        "trouble": None,
        "modes": modes,
        "controls": [],
    }
    return {**device, **changed}


@pytest.fixture
def picker(open_panel: OpenPanel) -> Picker:
    """Open the page at its sources with the given devices connected, recording what it opens.

    The returned function takes the devices and the hints; it returns the page, a list of the
    sources requested, and the server's answer, which the test may change.
    """

    def open_one(devices: list[Json], hints: Sequence[str] = ()) -> tuple[Page, list[str], Json]:
        page = open_panel(refusals=True)
        answer = {"cameras": devices, "hints": list(hints)}
        page.route("**/api/devices", lambda route: route.fulfill(json=answer))
        asked: list[str] = []
        page.on(
            "request",
            lambda request: (
                asked.append(json.loads(request.post_data)["source"])
                if request.method == "PUT" and request.url.endswith("/api/source")
                else None
            ),
        )
        page.get_by_role("tab", name="Source").click()
        page.get_by_role("button", name="Find cameras").click()
        return page, asked, answer

    return open_one


def test_the_chosen_cameras_and_settings_become_one_source(
    picker: Picker, keep_picture: KeepPicture
) -> None:
    in_use = _device(2, trouble=_BUSY)
    page, asked, answer = picker([_device(0), _device(1), in_use], [_SHARED])
    box = page.locator("observer-camera-picker")
    expect(box).to_contain_text("2 cameras are connected.")
    box.get_by_text("Left and right, image size, exposure").click()
    expect(box.locator(".warnings li")).to_have_text([_BUSY, _SHARED])
    # At first left and right are two different cameras, with compressed images to suit one bus.
    expect(box.get_by_label("Left camera")).to_have_value(_PORTS[0])
    expect(box.get_by_label("Right camera")).to_have_value(_PORTS[1])
    sizes = box.get_by_label("Size, format and rate")
    expect(sizes).to_have_value("size=640x480&format=MJPG&rate=30")
    box.get_by_label("Left camera").select_option(_PORTS[1])
    box.get_by_label("Right camera").select_option(_PORTS[0])
    sizes.select_option(label="1280 × 720, MJPG, 60 fps")
    box.get_by_text("Exposure, gain, focus").click()
    box.get_by_label("Exposure, 100 µs").fill("156")
    box.get_by_label("Focus").fill("0")
    box.get_by_label("Mains frequency, to avoid flicker").select_option("50")
    keep_picture(page, "cameras")

    # Another camera is connected: the choice stays.
    answer["cameras"] = [_device(0), _device(1), _device(3)]
    answer["hints"] = []
    page.get_by_role("button", name="Find cameras").click()
    expect(box).to_contain_text("3 cameras are connected.")
    expect(box.locator(".warnings li")).to_have_count(0)
    expect(box.get_by_label("Left camera")).to_have_value(_PORTS[1])

    box.get_by_role("button", name="Open these cameras").click()
    expect(box.locator("#camera-error")).not_to_be_empty(timeout=15_000)
    expect(page.locator("#source-error")).to_be_empty()
    kind, _, rest = asked[0].partition(":")
    assert kind == "camera"
    spec = parse_devices(rest)
    assert [target.address for target in spec.targets] == [_PORTS[1], _PORTS[0]]
    settings = spec.settings
    assert (settings.size, settings.pixel_format, settings.rate) == ((1280, 720), "MJPG", 60)
    assert (settings.exposure, settings.focus, settings.power_line_hz) == (156, 0, 50)
    assert (settings.gain, settings.white_balance) == (None, None)


def test_one_camera_can_show_both_images(picker: Picker) -> None:
    page, asked, answer = picker([_device(3)])
    box = page.locator("observer-camera-picker")
    expect(box).to_contain_text("One camera is connected")
    expect(box.get_by_label("Right camera")).to_have_value("")
    box.get_by_text("Left and right, image size, exposure").click()
    box.get_by_role("button", name="Open these cameras").click()
    expect(box.locator("#camera-error")).not_to_be_empty(timeout=15_000)
    assert asked == ["camera:sbs:/dev/video6?size=640x480&format=MJPG&rate=30"]

    answer["cameras"] = [_device(2, trouble=_BUSY)]
    page.get_by_role("button", name="Find cameras").click()
    expect(box).to_contain_text("No usable camera is connected")
    expect(box).to_contain_text(_BUSY)
    expect(box.get_by_role("button", name="Open these cameras")).to_be_hidden()


def test_two_cameras_share_a_tile_with_any_opening_error_below(
    server: Server, picker: Picker, keep_picture: KeepPicture
) -> None:
    page, asked, _ = picker([_device(0), _device(1)])
    tiles = page.locator("#sources-cameras")
    pair = tiles.locator(".source").first
    expect(pair).to_contain_text("HD Webcam")
    expect(pair).to_contain_text("Two cameras: /dev/video0 and /dev/video2")
    pair.click()
    error = tiles.locator(".source + .source-error")
    expect(error).not_to_be_empty(timeout=15_000)
    assert error.evaluate("(error) => error.previousElementSibling.dataset.spec") == asked[0]
    assert asked == [f"camera:{_PORTS[0]},{_PORTS[1]}?size=640x480&format=MJPG&rate=30"]
    assert server.get("/status")["source"]["spec"] == "simulated:lab"
    keep_picture(page, "cameras-refused")


def test_a_slow_first_device_list_does_not_overwrite_a_newer_one(open_panel: OpenPanel) -> None:
    page = open_panel()
    held: list[Any] = []

    def answer(route: Any) -> None:
        if not held:
            held.append(route)
            return
        route.fulfill(json={"cameras": [_device(0), _device(1)], "hints": [], "serial_ports": []})

    page.route("**/api/devices", answer)
    page.get_by_role("tab", name="Source").click()
    find = page.get_by_role("button", name="Find cameras")
    find.click()
    page.wait_for_timeout(200)
    find.click()
    box = page.locator("observer-camera-picker")
    expect(box).to_contain_text("2 cameras are connected.")
    held[0].fulfill(json={"cameras": [], "hints": [], "serial_ports": []})
    page.wait_for_timeout(300)
    expect(box).to_contain_text("2 cameras are connected.")


def test_uncalibrated_cameras_lead_to_the_wizard(server: Server, open_panel: OpenPanel) -> None:
    page = open_panel(refusals=True)
    page.get_by_role("tab", name="Source").click()
    offer = page.get_by_role("button", name="Calibrate these cameras")
    expect(offer).to_be_hidden()
    page.locator("#source-spec").fill("simulated:webcams")
    page.keyboard.press("Enter")
    expect(page.locator("#source-error")).to_contain_text("has no calibration", timeout=15_000)
    assert server.get("/status")["source"]["spec"] == "simulated:lab"
    offer.focus()
    page.keyboard.press("Enter")
    expect(page.get_by_role("heading", name="Calibrate: Board")).to_be_focused()
    expect(page.locator("#board-source")).to_have_value("simulated:webcams")
    page.get_by_role("button", name="Start with these cameras").click()
    expect(page.get_by_role("heading", name="Calibrate: Views")).to_be_focused(timeout=15_000)
    assert server.get("/status")["calibrating"]["source"] == "simulated:webcams"
    # Nobody holds a board there, and the page says so.
    expect(page.locator(".capture-words")).to_contain_text(re.compile("board|both", re.I))
    page.get_by_role("button", name="Exit").click()
    expect(page.locator("observer-calibration-wizard")).to_be_hidden()
    expect(offer).to_be_focused()


@pytest.fixture
def video_server() -> Callable[..., Any]:
    """The server of real video streams used by the cameras' own tests."""
    tests = Path(__file__).resolve().parents[1]
    path = tests / "observer" / "sources" / "cameras" / "video_server.py"
    spec = importlib.util.spec_from_file_location("video_server_of_cameras", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.VideoServer


@pytest.mark.slow
def test_network_cameras_show_what_they_deliver(
    server: Server,
    open_panel: OpenPanel,
    video_server: Callable[..., Any],
    keep_picture: KeepPicture,
) -> None:
    page = open_panel()
    with video_server() as left, video_server() as right:
        spec = f"{left.url},{right.url}"
        start = {"source": spec, "square_mm": 25}
        server.api.post("/api/calibrating", json=start).raise_for_status()
        expect(page.get_by_role("heading", name="Calibrate: Views")).to_be_visible(timeout=15_000)
        page.get_by_role("tab", name="Status").click()
        cameras = page.locator("observer-live-cameras")
        expect(cameras).to_contain_text("Left camera streaming")
        expect(cameras).to_contain_text("Right camera streaming")
        expect(cameras).to_contain_text(left.url)
        expect(cameras).to_contain_text("320x240")
        expect(cameras).to_contain_text(
            re.compile(r"median \d+\.\d ms, 95th percentile \d+\.\d ms"), timeout=15_000
        )
        keep_picture(page, "network-cameras")

        page.get_by_role("button", name="Check which camera is left").click()
        expect(page.locator("observer-cover-check")).to_contain_text("Cover the left lens")
        expect(page.get_by_role("button", name="Done")).to_be_visible()

        left.stop()
        trouble = cameras.locator("> .field-error")
        expect(trouble).to_contain_text(re.compile("left", re.I), timeout=10_000)
        expect(page.locator(".capture-words")).to_contain_text(re.compile("left", re.I))
        server.api.delete("/api/calibrating").raise_for_status()
    expect(cameras).to_be_hidden(timeout=15_000)
