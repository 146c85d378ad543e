"""A user at the real page in Chromium: holding a key and leaving the tab."""

from __future__ import annotations

import json
import time

from playwright.sync_api import Browser, Page
from playwright.sync_api import TimeoutError as PlaywrightTimeout

from ..chromium import hide, without_viewer
from .system import MOVING_MPS, SPEED_MPS, System

_KEY = "w"
_PATIENCE_S = 60.0
_REMEMBERED = "dynamic-observer.driving"


class Seat:
    """The page of a system on the robots' tab; it drives the observer at ``SPEED_MPS``."""

    def __init__(self, system: System, browser: Browser) -> None:
        self._system = system
        system.wait_for_sight()
        fastest = system.server.robot()["report"]["limits"]["speed_mps"]
        choice = json.dumps({"role": "observer", "share": SPEED_MPS / fastest})
        context = browser.new_context(viewport={"width": 1280, "height": 800})
        context.add_init_script(f"localStorage.setItem({_REMEMBERED!r}, {choice!r})")
        self._page: Page = context.new_page()
        without_viewer(self._page)
        # No pictures either: drawing them would take processor time from the robot's vision.
        self._page.route_web_socket("**/api/views/**", lambda _: None)
        self._page.goto(system.server.link)
        self._page.wait_for_selector('html[data-freshness="fresh"]', timeout=30_000)
        self._page.get_by_role("tab", name="Robots").click()

    def close(self) -> None:
        """Close the page."""
        self._page.context.close()

    def move(self) -> None:
        """Press the key until the robot drives, whatever its state."""
        deadline = time.monotonic() + _PATIENCE_S
        self.return_to_it()
        while not self._drive_off():
            # On a busy machine a frame or a command is occasionally late.
            assert time.monotonic() < deadline, self._page.locator("observer-robots").inner_text()
        time.sleep(self._system.random.uniform(0.0, 0.15))

    def _drive_off(self) -> bool:
        robot, page = self._system.robot.robot, self._page
        page.keyboard.up(_KEY)
        self._system.wait_for_sight()
        if not self._armed():
            try:
                page.get_by_role("button", name="Arm", exact=True).first.click(timeout=2_000)
            except PlaywrightTimeout:
                return False
            # Refused if a frame happens to be late.
            page.wait_for_timeout(100)
            if not self._armed():
                return False
        # After a missed command, holding counts again only once nothing was held for a moment.
        page.wait_for_timeout(300)
        page.locator(".drive-pad").focus()
        page.keyboard.down(_KEY)
        until, fastest = time.monotonic() + 2.5, 0.0
        while (speed := robot.speed_mps) < MOVING_MPS:
            fastest = max(fastest, speed)
            if speed < fastest - 0.05 or time.monotonic() > until:
                return False
            page.wait_for_timeout(10)
        return True

    def _armed(self) -> bool:
        return self._system.server.robot()["state"] in ("armed", "moving")

    def leave_the_tab(self) -> None:
        """Switch to another tab with the key still held."""
        hide(self._page, True)

    def return_to_it(self) -> None:
        """Switch back to this tab."""
        hide(self._page, False)
