"""Camera extrinsics on the robot: typed into the panel, refused there, or estimated."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from observer.simulation.scenarios import load_scenario

from .conftest import Eventually, KeepPicture, OpenPanel, Server

_IN_USE = "#pane-calibration observer-rig [role=status]"


@pytest.fixture(autouse=True)
def _unknown_before_and_after(server: Server, eventually: Eventually) -> Iterator[None]:
    def forget() -> None:
        if server.get("/rig")["mount"]:
            server.api.put("/api/rig", json={"mount": {}}).raise_for_status()

    eventually(lambda: server.get("/status")["engine"]["state"] == "preview", 40)
    forget()
    yield
    forget()


@pytest.fixture
def panel(open_panel: OpenPanel) -> Page:
    """The page at the rig panel, where values may be refused."""
    page = open_panel(refusals=True)
    page.get_by_role("tab", name="Calibration").click()
    return page


def _mount(server: Server) -> Any:
    return server.get("/status")["mount"]


def test_typed_values_are_validated_and_level_the_scene(
    server: Server, panel: Page, eventually: Eventually, keep_picture: KeepPicture
) -> None:
    true, rig = _mount(server), panel.locator("observer-rig")
    assert true["height_m"] != pytest.approx(0.83, abs=0.05)
    height, tilt = rig.get_by_label("Height, m"), rig.get_by_label("Tilt, °")
    use = panel.get_by_role("button", name="Use this mount")
    tilt.fill("12.5")
    # The wrong field is named and gets the focus.
    for typed, why in (("knee-high", "must be a number"), ("-3", "must be between 0.02 and 3")):
        height.fill(typed)
        use.click()
        expect(panel.locator("#rig-error")).to_have_text(re.compile(f"^Height {why}"))
        expect(height).to_be_focused()
        expect(height).to_have_attribute("aria-invalid", "true")
        expect(tilt).not_to_have_attribute("aria-invalid", "true")
        assert server.get("/rig")["mount"] == {}

    height.fill("0,83")
    use.click()
    expect(panel.locator(".notice")).to_contain_text("Saved for real cameras", timeout=15_000)
    expect(panel.locator("#rig-error")).to_be_empty()
    expect(height).not_to_have_attribute("aria-invalid", "true")
    # The lab knows its camera pose, which takes precedence over typed values.
    assert server.get("/rig")["mount"]["height_m"] == {"value": 0.83, "sigma": None}
    assert _mount(server) == true

    rig.get_by_label("Also use for simulated sources").check()
    use.click()
    mount = eventually(lambda: _mount(server) != true and _mount(server), 20)
    assert mount["height_m"] == pytest.approx(0.83)
    assert mount["tilt_rad"] == pytest.approx(math.radians(12.5))
    expect(panel.locator(_IN_USE).first).to_have_text(
        "In use: 0.83 m above the floor, tilted down by 12.5°.", timeout=15_000
    )
    keep_picture(panel, "rig")
    panel.reload()
    panel.get_by_role("tab", name="Calibration").click()
    expect(height).to_have_value("0.83")
    expect(rig.get_by_label("Also use for simulated sources")).to_be_checked()
    with panel.expect_download() as coming:
        panel.get_by_role("link", name="Download rig.yaml").click()
    assert "0.83" in coming.value.path().read_text()


def test_the_floor_estimate_fills_in_values_and_uncertainties(
    server: Server, panel: Page, keep_picture: KeepPicture
) -> None:
    camera, rig = load_scenario("lab").camera, panel.locator("observer-rig")
    rig.get_by_label("Pan, °").fill("1.5")
    button = panel.get_by_role("button", name="Estimate from the floor")
    button.focus()
    panel.keyboard.press("Enter")
    notes = panel.locator("observer-rig .rig-fields .field", has_text="estimated, ±")
    expect(notes).to_have_count(3, timeout=20_000)
    expect(button).to_be_focused()
    height = float(rig.get_by_label("Height, m").input_value())
    tilt = float(rig.get_by_label("Tilt, °").input_value())
    assert height == pytest.approx(camera.height_m, abs=0.03)
    assert tilt == pytest.approx(camera.tilt_deg, abs=1.0)
    assert abs(float(rig.get_by_label("Roll, °").input_value())) < 1.0
    expect(rig.get_by_label("Pan, °")).to_have_value("1.5")
    assert server.get("/rig")["mount"] == {}
    keep_picture(panel, "rig-floor")

    # An estimate overwritten by hand is no longer an estimate.
    rig.get_by_label("Roll, °").fill("0")
    expect(notes).to_have_count(2)
    panel.get_by_role("button", name="Use this mount").click()
    expect(panel.locator(".notice")).to_contain_text("Saved for real cameras", timeout=15_000)
    kept = server.get("/rig")["mount"]
    assert kept["height_m"]["sigma"] > 0
    assert kept["roll_deg"] == {"value": 0.0, "sigma": None}
    assert kept["pan_deg"] == {"value": 1.5, "sigma": None}
