"""Memorable moments, each as one continuous path through the page.

Others are where their parts are tested: the comparison in the first minute in ``test_methods``,
any click answered in ``test_asking``, ground truth aligned with a run in ``test_history``.
"""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Locator, Page, expect

from observer.calibration.formats.opencv_file import read_calibration

from .conftest import Eventually, KeepPicture, OpenPanel, Server
from .filmed_board import FilmedBoard
from .witness import Witness, report

# How long the person holds the board if its view is not captured because it resembles another.
_POSE_S = 2.0
_VIEWS_S = 120.0
# Simple enough for slow machines, where late frames would stop the robot.
_WALKER = """\
based_on: people
title: Somebody comes closer
help: One person walks towards the robot and back, again and again.
duration_s: 600
camera: {width: 320, height: 160}
observer: {motion: null}
people:
  - name: Ada
    x: 4.2
    y: -0.1
    heading_deg: 180
    motion:
      kind: course
      after: back
      acceleration: 1.0
      legs:
        - {kind: drive, distance_m: 2.2, speed: 0.9}
"""
_DRIVEN_S = 90.0
_RATE = 0.6
_BY_SOMEBODY = re.compile(r"^Guard: (Slowed|Stopped): .*(obstacle \d+|an object that starts)")


@pytest.fixture(autouse=True)
def _the_lab_before_and_after(server: Server, eventually: Eventually) -> Iterator[None]:
    """Leave the lab open, no calibration and no robot driving."""
    eventually(lambda: server.get("/status")["engine"]["state"] == "preview", 40)
    yield
    server.api.delete("/api/calibrating")
    server.api.post("/api/playback", json={"rate": 1.0})
    server.api.post("/api/robots/stop")
    server.api.post("/api/robots/reset")
    eventually(lambda: _opened(server, "simulated:lab"), 60)
    for kept in server.get("/calibrations"):
        server.api.delete(f"/api/calibrations/{kept['id']}").raise_for_status()


def _opened(server: Server, source: str) -> bool:
    return bool(server.api.put("/api/source", json={"source": source}).is_success)


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_two_webcams_are_calibrated_up_to_a_tape_check(
    server: Server, open_panel: OpenPanel, keep_picture: KeepPicture
) -> None:
    page = open_panel(refusals=True)
    with FilmedBoard() as film:
        # The two addresses, as read off the cameras.
        page.get_by_role("tab", name="Source").click()
        page.locator("#source-spec").fill(film.spec)
        page.keyboard.press("Enter")
        expect(page.locator("#source-error")).to_contain_text("no calibration", timeout=20_000)
        keep_picture(page, "moment-webcams-1-uncalibrated")
        page.get_by_role("button", name="Calibrate these cameras").click()
        expect(page.locator("#board-source")).to_have_value(film.spec)
        page.get_by_label("Square, mm").fill("25")
        page.get_by_role("button", name="Start with these cameras").click()
        expect(page.get_by_role("heading", name="Calibrate: Views")).to_be_focused(timeout=20_000)

        _show_board(page, film)
        keep_picture(page, "moment-webcams-2-views")
        page.get_by_role("button", name="Compute calibration").click()
        verdict = page.locator("observer-result-step .verdict.big")
        expect(verdict).to_have_text(re.compile(r"At 3 m, depth is accurate to ± "), timeout=90_000)
        keep_picture(page, "moment-webcams-3-result")
        film.put_away()
        page.locator("#result-name").fill("Desk")
        page.get_by_role("button", name="Save and use").click()
        expect(page.locator("observer-calibration-wizard")).to_be_hidden(timeout=20_000)
        expect(page.locator(".headline-context")).to_contain_text("calibration Desk")

        page.get_by_role("tab", name="Calibration").click()
        page.get_by_role("button", name="Preview calibration Desk").click()
        dialog = page.get_by_role("dialog")
        dialog.get_by_text("Tape check", exact=True).click()
        u, v = _choose_flat_place(dialog, page)
        (kept,) = server.get("/calibrations")
        found = read_calibration(
            server.api.get(f"/api/calibrations/{kept['id']}/file").text, name="Desk"
        )
        true = film.distance_m(found, u, v)
        dialog.get_by_label("Tape measurement, m").fill(f"{true:.2f}")
        dialog.get_by_role("button", name="Compare").click()
        checks = dialog.locator(".tape-check li")
        expect(checks).to_have_count(1)
        expect(checks).to_contain_text("within the expected ±")
        keep_picture(page, "moment-webcams-4-tape")
        # A tape measurement a fifth too long disagrees, and the page says what may be wrong.
        dialog.get_by_label("Tape measurement, m").fill(f"{1.2 * true:.2f}")
        dialog.get_by_role("button", name="Compare").click()
        expect(checks).to_have_count(2)
        expect(dialog.locator(".tape-check")).to_contain_text("more than the expected ±")
        page.keyboard.press("Escape")


def _show_board(page: Page, film: FilmedBoard) -> None:
    """Hold the board in one pose after another until the page says it has enough views."""
    taken, words = page.locator(".view-list li"), page.locator(".capture-words")
    deadline = time.monotonic() + _VIEWS_S
    while not re.search("enough views", words.inner_text(), re.I):
        assert time.monotonic() < deadline, words.inner_text()
        before, since = taken.count(), time.monotonic()
        while taken.count() == before and time.monotonic() < since + _POSE_S:
            page.wait_for_timeout(100)
        film.next_pose()


def _choose_flat_place(dialog: Locator, page: Page) -> tuple[float, float]:
    """Move the mark until a distance is shown; return its pixel."""
    said = dialog.locator(".tape-check [role=status]")
    dialog.get_by_role("button", name="Choose the image centre").click()
    canvas = dialog.locator("canvas")
    width, height = canvas.evaluate("(e) => [e.width, e.height]")
    u, v = width / 4, height / 2
    for du, dv in [(0, -8)] * 12 + [(-8, 0)] * 12:
        expect(said).not_to_be_empty()
        if said.inner_text().startswith("Stereo distance: "):
            return u, v
        key = "ArrowUp" if dv else "ArrowLeft"
        with page.expect_response("**/depth?*"):
            page.keyboard.press(key)
        u, v = u + du, v + dv
    pytest.fail(f"nothing flat was found: {said.inner_text()}")


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_robot_yields_to_a_pedestrian_and_states_why(
    server: Server,
    open_panel: OpenPanel,
    eventually: Eventually,
    keep_picture: KeepPicture,
    tmp_path: Path,
) -> None:
    scenario = tmp_path / "somebody_comes.yaml"
    scenario.write_text(_WALKER)
    eventually(lambda: _opened(server, f"simulated:{scenario}"), 60)
    page = open_panel(refusals=True)
    page.get_by_role("tab", name="Robots").click()
    page.locator("input[name=drive-role][value=observer]").check(force=True)
    page.locator("#drive-share").fill("60")
    # Fewer frames per second, so that fewer are late on a busy machine.
    server.api.post("/api/playback", json={"rate": _RATE}).raise_for_status()
    page.get_by_label("Residual").first.uncheck()
    _drive_until_held_back(page)
    keep_picture(page, "moment-walker")
    with Witness(server, "observer") as witness:
        # It may still be driving slowly: slowed, not yet stopped, when the key is released.
        released = time.monotonic()
        page.keyboard.up("w")
        report("released before a person", witness.zero_after(released))
        witness.stays_zero(0.4)
    expect(page.locator(".drive-sent")).to_contain_text("Sent: standstill")
    keep_picture(page, "moment-walker-released")


def _drive_until_held_back(page: Page) -> None:
    """Hold the key until a person makes the guard hold the robot back, as shown beside the pad.

    On a busy machine a frame is occasionally late, which also stops the robot: then drive on.
    """
    deadline = time.monotonic() + _DRIVEN_S
    said: Counter[str] = Counter()
    arm = page.get_by_role("button", name="Arm", exact=True)
    while time.monotonic() < deadline:
        page.keyboard.up("w")
        if arm.is_visible() and arm.is_enabled():
            arm.click()
            page.wait_for_timeout(200)
        page.locator(".drive-pad").focus()
        page.keyboard.down("w")
        until = time.monotonic() + 6.0
        while time.monotonic() < until:
            words = page.locator(".guard-words").inner_text()
            said[words] += 1
            if _BY_SOMEBODY.search(words):
                return
            page.wait_for_timeout(50)
    pytest.fail(f"nobody held it back: {said}")
