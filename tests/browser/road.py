"""A network between page and server that the test controls."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest
from playwright.sync_api import Page, WebSocketRoute

from .witness import TRIES, Witness


class Road:
    """Routes the drive socket through the test, which can delay both directions or drop all."""

    def __init__(self, page: Page) -> None:
        self.delay_s = 0.0
        self.lost = False
        self._waiting: list[tuple[float, Callable[[], None]]] = []
        self._page = page
        page.route_web_socket("**/api/drive*", self._take)

    def _take(self, route: WebSocketRoute) -> None:
        server = route.connect_to_server()
        route.on_message(lambda text: self._pass(lambda: server.send(text)))
        server.on_message(lambda text: self._pass(lambda: route.send(text)))

    def _pass(self, send: Callable[[], None]) -> None:
        if self.lost:
            return
        if self.delay_s == 0 and not self._waiting:
            send()
        else:
            self._waiting.append((time.monotonic() + self.delay_s, send))

    def go_on(self, for_s: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Let messages pass; return whether ``until`` came true in time."""
        end = time.monotonic() + for_s
        while time.monotonic() < end:
            while self._waiting and self._waiting[0][0] <= time.monotonic():
                self._waiting.pop(0)[1]()
            if until():
                return True
            self._page.wait_for_timeout(10)
        return False

    def drive(self, witness: Witness) -> None:
        """Hold a key until the robot moves."""
        for _ in range(TRIES):
            self._page.keyboard.down("w")
            if self.go_on(1.5, lambda: witness.moves):
                return
            self._page.keyboard.up("w")
            self.go_on(0.4)
        pytest.fail(f"it did not move: {self._page.locator('observer-robots').inner_text()}")
