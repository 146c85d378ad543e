"""Fixtures of manual driving: a simulated room, and a page at its controls."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from playwright.sync_api import Page

from ..conftest import Eventually, OpenPanel, Server
from ..goal_steps import open_source
from .steps import Seat, arm


@pytest.fixture(scope="package")
def room(server: Server, eventually: Eventually) -> Iterator[Server]:
    """The server on a simulated room with space to drive."""
    open_source(server, "simulated:drive")
    eventually(lambda: _all_disarmed(server), 60)
    # The obstacle needs no images: play slowly, to leave the processor to the page.
    _play(server, 0.2)
    yield server
    open_source(server, "simulated:lab")
    _play(server, 1.0)


def _play(server: Server, rate: float) -> None:
    server.api.post("/api/playback", json={"rate": rate}).raise_for_status()


def _all_disarmed(server: Server) -> bool:
    robots = server.get("/robots")["robots"].values()
    return all(robot and robot["state"] == "disarmed" for robot in robots)


@pytest.fixture(autouse=True)
def _begin_at_rest(room: Server) -> None:
    room.api.post("/api/robots/stop").raise_for_status()
    room.api.post("/api/robots/reset").raise_for_status()


@pytest.fixture
def seat(open_panel: OpenPanel) -> Seat:
    """A page on the robots' tab with the obstacle chosen; ``armed`` arms it as well."""

    def sit(
        *, armed: bool = True, before: Callable[[Page], object] = lambda _: None, **options: Any
    ) -> Page:
        page = open_panel(**options)
        before(page)
        page.get_by_role("tab", name="Robots").click()
        page.locator("input[name=drive-role][value=obstacle]").check(force=True)
        # Slowly, so that it does not reach a wall.
        page.locator("#drive-share").fill("5")
        if armed:
            arm(page)
        return page

    return sit
