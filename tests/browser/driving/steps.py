"""Steps for driving the obstacle by hand on the page."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest
from playwright.sync_api import Locator, Page, expect

from ..witness import TRIES, Witness

# Opens a page on the robots' tab.
Seat = Callable[..., Page]


def arm(page: Page) -> None:
    page.get_by_role("button", name="Arm", exact=True).click()
    expect(role_card(page).locator(".state-chip")).to_have_text("Armed")
    expect(page.locator(".pad-state")).to_contain_text("Ready")


def role_card(page: Page, role: str = "obstacle") -> Locator:
    return page.locator(f".role-card:has([value={role}])")


def open_run_options(page: Page) -> None:
    """Open a field to type in: that of a run's name."""
    if not page.locator("#run-name").is_visible():
        page.get_by_role("button", name="Run options").click()


def press_pad(page: Page, right: float = 0.5, down: float = 0.15) -> None:
    """Hold the pad at a position, 0 to 1 of its width and height."""
    box = page.locator(".drive-pad").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + right * box["width"], box["y"] + down * box["height"])
    page.mouse.down()


def drive(
    page: Page, witness: Witness, press: Callable[[], object], let_go: Callable[[], object]
) -> None:
    """Hold until the robot moves; retry if a busy machine held up the page."""
    for _ in range(TRIES):
        start = time.monotonic()
        press()
        if witness.first(True, start, 1.5) is not None and witness.moves:
            return
        let_go()
        page.wait_for_timeout(300)
    pytest.fail(f"it did not move: {page.locator('observer-robots').inner_text()}")
