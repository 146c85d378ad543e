"""Rigid motion, the default model, in the panel; switching live to the paper's and back."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from observer.obstacle_colors import OBSTACLE_RGB

from .conftest import Eventually, KeepPicture, OpenPanel, Pixels, Server

Confirmed = Callable[..., tuple[Page, int]]

_MODEL = "#parameter-ego_motion-model"
_MOVES = re.compile(r"Obstacle (\d+) moves at (\d+\.\d\d) ± \d+\.\d\d m/s")


@pytest.fixture(autouse=True)
def _as_it_begins(server: Server, eventually: Eventually) -> Iterator[None]:
    """Each test starts with, and leaves, the default preset and running playback."""

    def reset() -> None:
        defaults = next(p["values"] for p in server.get("/presets") if p["name"] == "default")
        server.api.patch("/api/parameters", json=defaults).raise_for_status()
        server.api.post("/api/playback", json={"paused": False}).raise_for_status()

    eventually(lambda: server.get("/status")["source"], 30)
    reset()
    yield
    reset()


@pytest.fixture
def confirmed(server: Server, open_panel: OpenPanel) -> Confirmed:
    """A page paused at a confirmed obstacle, and the obstacle's number."""

    def open_one(**options: Any) -> tuple[Page, int]:
        page = open_panel(**options)
        line = page.locator(".headline-text")
        expect(line).to_have_text(_MOVES, timeout=40_000)
        server.api.post("/api/playback", json={"paused": True}).raise_for_status()
        expect(page.locator("html")).to_have_attribute("data-freshness", "held", timeout=10_000)
        expect(line).to_have_text(_MOVES)
        return page, int(_MOVES.search(line.inner_text()).group(1))

    return open_one


def test_a_confirmed_obstacle_has_a_box_and_a_row(
    confirmed: Confirmed, pixels: Pixels, keep_picture: KeepPicture
) -> None:
    page, number = confirmed(color_scheme="light")
    row = page.locator("observer-obstacles tbody tr").first
    expect(row).to_contain_text(re.compile(rf"{number}\s*\d\.\d\d ± \d\.\d\d"))
    why = page.locator("observer-obstacles tr.why").first
    reason = r"Moving, [a-z ]+\. \d+ feature points on one rigid body"
    expect(why).to_contain_text(re.compile(reason))
    # The rectangle in the picture is in the colour of what moves, arrows of moving points are red.
    for view, colour in (("left", OBSTACLE_RGB["moving"][::-1]), ("residual", (60, 60, 255))):
        canvas = page.locator(f'observer-live-view[data-view="{view}"] canvas')
        near = abs(pixels(canvas).astype(int) - colour).max(axis=2) < 70
        assert near.sum() > 20, view
    keep_picture(page, "rigid")


def _is_significant(answer: dict[str, Any]) -> bool:
    """Return whether the pixel is on a moving point of an obstacle.

    The answer differs for a significant pixel beside an obstacle that is not one of its points yet.
    Numbers that do not apply are absent.
    """
    numbers = answer["numbers"]
    significance, threshold = (numbers.get(key) or 0 for key in ("significance", "threshold"))
    on_it = re.search(r"obstacles\.min_points|is separate in depth", answer["would_change"])
    return bool(on_it) and significance > threshold


def test_pixels_are_explained_with_numbers(server: Server, confirmed: Confirmed) -> None:
    page, number = confirmed()
    camera = server.get("/status")["camera"]
    places = [(u, v) for v in range(8, camera["height"], 12) for u in range(8, camera["width"], 12)]
    answers = [server.get(f"/pixel?u={u}&v={v}") for u, v in places]
    verdicts = {answer["verdict"] for answer in answers}
    assert {"dynamic", "static", "too_few_features"} <= verdicts
    of_it = [a for a in answers if a["obstacle"] and a["obstacle"]["id"] == number]
    points = [a for a in of_it if _is_significant(a)]
    assert points, [a["would_change"] for a in of_it]
    # A click may miss the intended pixel, as the picture is scaled down.
    told = next(
        a
        for a in points
        if all(
            _is_significant(server.get(f"/pixel?u={a['u'] + right}&v={a['v'] + down}"))
            for right, down in ((-2, 0), (2, 0), (0, -2), (0, 2))
        )
    )
    assert told["numbers"]["speed_mps"] > 0.05
    assert told["numbers"]["significance"] > told["numbers"]["threshold"]

    pick = page.locator(".pixel-pick")
    pick.scroll_into_view_if_needed()
    box = pick.bounding_box()
    x = (told["u"] + 0.5) / camera["width"] * box["width"]
    pick.click(position={"x": x, "y": (told["v"] + 0.5) / camera["height"] * box["height"]})
    card = page.locator(".answer")
    expect(card.locator(".verdict-chip")).to_have_text("Moving")
    expect(card).to_contain_text(re.compile(r"It moves at \d\.\d\d m/s over ground"))
    expect(card).to_contain_text(re.compile(r"Speed, 95 % interval ?±? ?\d\.\d+ m/s"))

    still = next(a for a in answers if a["verdict"] == "static")
    assert still["numbers"]["least_speed_mps"] < 1
    assert re.search(r"Anything faster than \d+\.\d\d m/s", still["would_change"])


def test_the_model_can_be_switched_live_and_back(
    server: Server, open_panel: OpenPanel, eventually: Eventually, keep_picture: KeepPicture
) -> None:
    page = open_panel()
    page.locator("input[name=view][value=warped]").check()
    page.get_by_role("tab", name="Parameters").click()
    expect(page.locator(_MODEL)).to_have_value("rigid")
    unused = page.locator("observer-parameters .unused-groups")
    flow, bodies = "#parameter-flow-window_px", "#parameter-obstacles-margin"
    expect(unused.locator("summary").first).to_contain_text("not used by the rigid method")
    expect(unused.locator(flow)).to_have_count(1)
    expect(unused.locator(bodies)).to_have_count(0)
    line = page.locator(".headline-text")
    numbers = []
    for model, has_parts in (("affine", True), ("rigid", False)):
        expect(line).to_have_text(_MOVES, timeout=40_000)
        numbers.append(int(_MOVES.search(line.inner_text()).group(1)))
        page.locator(_MODEL).select_option(model)
        revision = re.compile(r"In use since frame \d+")
        expect(page.locator(".revision")).to_have_text(revision, timeout=10_000)
        ego = eventually(
            lambda model=model: (
                (now := server.get("/status")["ego_motion"]) and now["model"] == model and now
            )
        )
        assert (ego["decomposition"] is not None) == has_parts
        idle = f"not used by the {model} method"
        expect(unused.locator("summary").first).to_contain_text(idle)
        expect(unused.locator(flow if model == "rigid" else bodies)).to_have_count(1)
        keep_picture(page, f"changed-to-{model}")
    expect(line).to_have_text(_MOVES, timeout=40_000)
    numbers.append(int(_MOVES.search(line.inner_text()).group(1)))
    # Each change started a new segment, and numbers are never reused.
    assert len(set(numbers)) == 3
    assert numbers == sorted(numbers)
