"""Steps for sending the observer to a goal on the page."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable

import pytest
from playwright.sync_api import Error, Locator, Page, expect

from .conftest import Server

DRIVEN_S = 90.0


def open_source(server: Server, source: str) -> None:
    """Open a source, retrying while the engine is starting."""
    deadline = time.monotonic() + 60.0
    while not server.api.put("/api/source", json={"source": source}).is_success:
        assert time.monotonic() < deadline, source
        time.sleep(1.0)


def goal_section(page: Page) -> Locator:
    return page.locator("observer-goal")


def on_robots_tab(page: Page) -> Page:
    page.get_by_role("tab", name="Robots").click()
    page.locator("input[name=drive-role][value=observer]").check(force=True)
    expect(goal_section(page).get_by_role("heading", name="Drive to a goal")).to_be_visible()
    return page


def arm_observer(page: Page) -> bool:
    """Arm the observer if it is not; return whether a goal can be sent."""
    arm = page.get_by_role("button", name="Arm", exact=True)
    if arm.is_visible() and arm.is_enabled():
        # The button may change meanwhile.
        with contextlib.suppress(Error):
            arm.click(timeout=2000)
        page.wait_for_timeout(300)
    return goal_section(page).get_by_role("button", name="Drive there").is_enabled()


def until_driving(page: Page, send: Callable[[], object]) -> None:
    """Send the observer until it drives to the goal.

    On a busy machine a frame is occasionally late, which ends the drive: it is then sent again.
    """
    deadline = time.monotonic() + DRIVEN_S
    giving_up = goal_section(page).get_by_role("button", name="Cancel goal")
    while time.monotonic() < deadline:
        if not giving_up.is_visible() and arm_observer(page):
            send()
            page.wait_for_timeout(300)
        if giving_up.is_visible():
            return
    pytest.fail(f"it was not sent: {goal_section(page).inner_text()}")
