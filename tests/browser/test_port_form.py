"""What the page suggests as a robot's port; the devices are faked at the REST interface."""

from __future__ import annotations

from typing import Any

import pytest
from playwright.sync_api import Locator, Page, expect

from .conftest import Eventually, Json, OpenPanel, Server

_BY_ID = "/dev/serial/by-id/usb-Prolific_2303-if00-port0"
_LOCKED = "only the group dialout may use /dev/ttyACM1; join it"


def _port(path: str, **changed: Any) -> Json:
    plain = {"by_id": None, "description": None, "usable": True, "trouble": None}
    return {"path": path, **plain, **changed}


@pytest.fixture(autouse=True)
def _a_robot(server: Server, eventually: Eventually) -> None:
    eventually(lambda: server.get("/robots")["robots"]["observer"], 40)


def _opened_form(page: Page) -> Locator:
    page.get_by_role("tab", name="Robots").click()
    # By then the page has decided whether to open the form by itself.
    chip = page.locator(".role-card:has([value=observer]) .state-chip")
    expect(chip).not_to_have_text("No robot")
    form = page.locator("observer-robot-port")
    if not form.is_visible():
        page.get_by_text("Port and model").click()
    return form


def test_connected_serial_ports_are_suggested_by_stable_names(
    open_panel: OpenPanel,
) -> None:
    page = open_panel(viewer=False)
    ports = [
        _port("/dev/ttyUSB0", by_id=_BY_ID, description="USB-Serial Controller"),
        _port("/dev/ttyACM1", usable=False, trouble=_LOCKED),
    ]
    page.route(
        "**/api/devices",
        lambda route: route.fulfill(json={"cameras": [], "serial_ports": ports, "hints": []}),
    )
    form = _opened_form(page)
    look = form.get_by_role("button", name="Find ports")
    look.click()
    told = form.get_by_role("status")
    expect(told).to_contain_text("/dev/ttyUSB0 (USB-Serial Controller)")
    expect(told).to_contain_text("/dev/ttyACM1, access denied")
    expect(form.get_by_text(_LOCKED)).to_be_visible()
    suggested = form.locator("datalist option").evaluate_all("all => all.map(({value}) => value)")
    assert suggested[:2] == [_BY_ID, "/dev/ttyACM1"]
    assert [value.partition(":")[0] for value in suggested[2:]] == [
        "socket", "external", "coppeliasim",
    ]  # fmt: skip
    # Unplugged meanwhile.
    ports.clear()
    look.click()
    expect(told).to_have_text("The server has no USB serial port.")
    expect(form.get_by_text(_LOCKED)).to_have_count(0)
    assert form.locator("datalist option").count() == len(suggested) - 2


def test_a_key_is_stored_and_never_shown_again(server: Server, open_panel: OpenPanel) -> None:
    key = "0123456789abcdefSECRET"
    shown = "external:127.0.0.1:7799"
    page = open_panel(viewer=False)
    form = _opened_form(page)
    port = form.get_by_label("Port", exact=True)
    try:
        port.fill(f"{shown}?key={key}")
        port.press("Enter")
        expect(port).to_have_value(shown)
        assert key not in page.content()
        # Another model with the port as shown: the key is kept.
        form.get_by_label("Model").select_option("p3dx")
        with page.expect_response("**/api/robots/observer/port") as answer:
            form.get_by_role("button", name="Connect").click()
        assert answer.value.ok
        assert server.get("/robots")["ports"]["observer"] == {"port": shown, "model": "p3dx"}
        assert f"{shown}?key={key}" in server.api.get("/api/rig/file").text
        form.get_by_role("button", name="Remove port").click()
        expect(port).to_have_value("")
    finally:
        server.api.delete("/api/robots/observer/port").raise_for_status()
    assert key not in server.api.get("/api/rig/file").text
