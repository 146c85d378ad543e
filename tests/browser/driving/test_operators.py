"""Operators of a robot: taking over, presence, and the check of its guard."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest
from playwright.sync_api import Page, expect

from ..conftest import Eventually, KeepPicture, Server
from ..witness import TRIES, Witness, report
from .steps import Seat, arm, drive, role_card

# Record when the page asks for control, ms since the epoch.
_NOTE_WHEN_ASKED = """() => {
  const { send } = WebSocket.prototype;
  WebSocket.prototype.send = function (message) {
    if (String(message).includes('"take"')) window.askedAt = Date.now();
    send.call(this, message);
  };
}"""


def test_a_second_operator_takes_over_and_the_first_is_notified(
    room: Server, seat: Seat, eventually: Eventually
) -> None:
    first = seat()
    second = seat(armed=False, refusals=True)
    expect(role_card(second)).to_contain_text("has control")
    expect(second.get_by_role("button", name="Arm", exact=True)).to_be_hidden()
    with Witness(room) as witness:
        first.bring_to_front()
        drive(first, witness, lambda: first.keyboard.down("w"), lambda: first.keyboard.up("w"))
        second.evaluate(_NOTE_WHEN_ASKED)
        second.get_by_role("button", name="Take control").evaluate("button => button.click()")
        asked = eventually(lambda: second.evaluate("window.askedAt ?? null")) / 1000
        # Not measured from the click, as the page may have to connect first.
        report("taken over", witness.zero_after(asked - time.time() + time.monotonic()))
        # The first page's key is still down and moves nothing.
        witness.stays_zero(0.4)
        expect(role_card(second)).to_contain_text("You have control")
        expect(role_card(first)).not_to_contain_text("You have control")
        expect(first.get_by_role("button", name="Take control")).to_be_visible()
        first.keyboard.up("w")
        second.bring_to_front()
        arm(second)
        drive(second, witness, lambda: second.keyboard.down("w"), lambda: second.keyboard.up("w"))
        # Any watcher may stop it.
        start = time.monotonic()
        first.locator("#stop-robots").evaluate("button => button.click()")
        report("stopped by somebody else", witness.zero_after(start))
    expect(second.locator(".stop-state")).to_contain_text("Stopped by")


def test_a_programme_runs_while_its_operator_is_present(
    room: Server, seat: Seat, hide_page: Callable[[Page, bool], None]
) -> None:
    page = seat(refusals=True)
    both = page.locator("[data-programme=figure17_a]")
    expect(both.get_by_role("button", name="Start")).to_be_disabled()
    expect(both).to_contain_text("Arm the observer first")
    with Witness(room) as witness:
        page.get_by_role("button", name="Start Square of 2 m, obstacle").click()
        expect(page.locator(".programme-running progress")).to_be_visible()
        assert witness.first(True, time.monotonic(), 8.0) is not None
        # Presence ends when the page is hidden.
        start = time.monotonic()
        hide_page(page, True)
        report("programme without its operator", witness.zero_after(start))
    hide_page(page, False)
    expect(page.locator(".programme-running")).to_be_hidden()


@pytest.mark.patient
def test_a_guard_check_survives_closing_the_page(
    room: Server, seat: Seat, eventually: Eventually, keep_picture: KeepPicture
) -> None:
    page = seat()
    page.get_by_text("Guard check").click()
    section = page.locator("observer-guard-check")
    expect(section.locator(".check-advice")).to_contain_text("not been checked yet")
    page.locator("#check-note").fill("a test")
    page.get_by_role("button", name="Start check").click()
    expect(section.locator(".check-instruction")).to_contain_text("steps in front")
    page.get_by_role("button", name="Skip step").click()
    expect(section.locator(".check-now")).to_contain_text("step 2 of 2: Close the browser")
    # The step does not count this drive, as it does not end the way the step asks.
    page.locator("#drive-share").fill("40")
    _speed_up(page, room, "w")
    page.keyboard.press("Escape")
    page.keyboard.up("w")
    expect(section.locator(".check-result")).to_contain_text("(stop, not expired or lease)")
    section.scroll_into_view_if_needed()
    keep_picture(page, "guard-check")
    page.get_by_role("button", name="Reset").click()
    eventually(lambda: _speed(room) < 0.01)
    arm(page)
    _speed_up(page, room, "s")
    page.close()
    eventually(lambda: room.get("/robots/check")["check"]["record"])
    page = seat(armed=False)
    page.get_by_text("Guard check").click()
    steps = page.locator(".check-steps > li")
    expect(steps.nth(0)).to_contain_text("Skipped by")
    expect(steps.nth(1)).to_contain_text("stop command sent after")
    (step,) = room.get("/robots/check")["check"]["steps"][1:]
    assert step["state"] in ("passed", "failed")
    assert step["figures"]["distance_m"] > 0.0
    report("page closed, as the check measured it", step["figures"]["zero_ms"] / 1000)
    record = page.locator(".check-records > li").first
    expect(record).to_contain_text("a test")
    with page.expect_download() as download:
        record.get_by_text("Text").click()
    assert "| Close the browser |" in download.value.path().read_text()
    keep_picture(page, "guard-check-record")


def _speed_up(page: Page, server: Server, key: str) -> None:
    """Hold a key until it counts as driving for a check; retry if the page was held up."""
    page.locator(".drive-pad").focus()
    for _ in range(TRIES):
        page.keyboard.down(key)
        end = time.monotonic() + 3.0
        while time.monotonic() < end:
            # A robot that still rolls but is already sent zero cannot be stopped any more.
            robot = server.get("/robots")["robots"]["obstacle"]
            if abs(robot["report"]["speed_mps"] or 0.0) > 0.15 and robot["sent"]["speed_mps"]:
                return
            time.sleep(0.02)
        page.keyboard.up(key)
        page.wait_for_timeout(300)
    pytest.fail(f"it did not drive: {page.locator('observer-robots').inner_text()}")


def _speed(server: Server) -> float:
    robot = server.get("/robots")["robots"]["obstacle"]
    return abs(robot["report"]["speed_mps"] or 0.0)
