"""One can ask about any pixel why it is classified as it is, and every obstacle says why."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from .conftest import Eventually, Json, KeepPicture, OpenPanel, Server

_STEP_PX = 16

Standing = Callable[..., tuple[Page, Json]]


@pytest.fixture
def standing(server: Server, open_panel: OpenPanel, eventually: Eventually) -> Iterator[Standing]:
    """A page with a paused picture, and a moving pixel in it."""

    def open_one(**options: Any) -> tuple[Page, Json]:
        eventually(lambda: server.get("/status")["source"], 30)
        # Other tests may have left the playback paused.
        server.api.post("/api/playback", json={"paused": False}).raise_for_status()
        page = open_panel(**options)
        found = None
        while found is None:
            moving = page.locator(".headline-text")
            expect(moving).to_have_text(re.compile(r"Obstacle \d+ moves"), timeout=30_000)
            server.api.post("/api/playback", json={"paused": True}).raise_for_status()
            eventually(lambda: server.get("/status")["playback"]["paused"])
            found = _pixel(server, lambda answer: bool(answer["obstacle"]))
            if found is None:
                server.api.post("/api/playback", json={"paused": False}).raise_for_status()
                page.wait_for_timeout(1000)
        return page, found

    yield open_one
    server.api.post("/api/playback", json={"paused": False}).raise_for_status()


def _pixel(server: Server, wanted: Callable[[Json], bool]) -> Json | None:
    """Return the answer for a pixel where it and its surroundings are as wanted, or None."""
    camera = server.get("/status")["camera"]
    for v in range(_STEP_PX, camera["height"], _STEP_PX):
        for u in range(_STEP_PX, camera["width"], _STEP_PX):
            # A click may miss by a pixel, so the surroundings must qualify, too.
            around = [(u, v), (u - 2, v - 2), (u + 2, v - 2), (u - 2, v + 2), (u + 2, v + 2)]
            answers = (server.get(f"/pixel?u={x}&v={y}") for x, y in around)
            if all(map(wanted, answers)):
                found: Json = server.get(f"/pixel?u={u}&v={v}")
                return found
    return None


def _with_titles(server: Server, words: str) -> str:
    """Return the words with each parameter named as in its field."""
    for entry in server.get("/parameters/schema"):
        words = words.replace(entry["name"], entry["title"])
    return words


def _of(verdict: str) -> Callable[[Json], bool]:
    return lambda answer: bool(answer["verdict"] == verdict)


def _click(page: Page, u: float, v: float, camera: Json) -> None:
    pick = page.locator(".pixel-pick")
    pick.scroll_into_view_if_needed()
    box = pick.bounding_box()
    x = (u + 0.5) / camera["width"] * box["width"]
    y = (v + 0.5) / camera["height"] * box["height"]
    pick.click(position={"x": x, "y": y})


def test_a_click_on_the_image_explains_the_pixel(
    server: Server, standing: Standing, keep_picture: KeepPicture
) -> None:
    page, told = standing()
    camera = server.get("/status")["camera"]
    _click(page, told["u"], told["v"], camera)
    card = page.locator(".answer")
    expect(card.locator(".verdict-chip")).to_have_text("Moving")
    # The picture may be scaled down, so a click cannot hit every pixel exactly.
    where = card.locator(".answer-head .figure")
    expect(where).to_have_text(re.compile(r"Pixel \d+, \d+ · frame \d+"))
    u, v, frame = (int(n) for n in re.findall(r"\d+", where.inner_text()))
    assert abs(u - told["u"]) <= 2
    assert abs(v - told["v"]) <= 2
    same = server.get(f"/pixel?u={u}&v={v}")
    assert frame == same["frame"]
    expect(card).to_contain_text(same["sentence"])
    change = _with_titles(server, same["would_change"])
    expect(card).to_contain_text(f"What would change it: {change}")
    expect(card).to_contain_text(f"Obstacle {same['obstacle']['id']}")
    speed = card.locator("dl div", has=page.locator("dt", has_text=re.compile("^Speed$")))
    mps = same["numbers"]["speed_mps"]
    # If no point is near, the pixel counts as moving only by the body's depth segment.
    expect(speed.locator("dd")).to_have_text("unknown" if mps is None else f"{mps:.2f} m/s")
    mark = page.locator(".pixel-mark").bounding_box()
    picture = page.locator(".pixel-pick").bounding_box()
    middle = (mark["x"] + mark["width"] / 2 - picture["x"]) / picture["width"]
    assert middle == pytest.approx((u + 0.5) / camera["width"], abs=0.003)
    keep_picture(page, "answer")

    page.keyboard.press("Escape")
    expect(card).to_be_hidden()
    expect(page.locator(".pixel-mark")).to_be_hidden()


def test_static_and_featureless_pixels_are_explained(
    server: Server, standing: Standing, keep_picture: KeepPicture
) -> None:
    page, _ = standing()
    card = page.locator(".answer")
    for verdict, words in (("static", "Static"), ("too_few_features", "Too few features")):
        told = _pixel(server, _of(verdict))
        assert told is not None, verdict
        _click(page, told["u"], told["v"], server.get("/status")["camera"])
        expect(card.locator(".verdict-chip")).to_have_text(words)
        where = card.locator(".answer-head .figure").inner_text()
        u, v, _frame = (int(n) for n in re.findall(r"\d+", where))
        same = server.get(f"/pixel?u={u}&v={v}")
        expect(card).to_contain_text(same["sentence"])
        expect(card).to_contain_text(_with_titles(server, same["would_change"]))
        card.scroll_into_view_if_needed()
        keep_picture(page, f"answer-{verdict}")


def test_the_marker_moves_by_keyboard_and_enter_explains_the_pixel(
    server: Server, standing: Standing
) -> None:
    page, _ = standing()
    camera = server.get("/status")["camera"]
    page.locator(".pixel-pick").focus()
    for key in ("ArrowRight", "ArrowRight", "ArrowUp", "Shift+ArrowLeft"):
        page.keyboard.press(key)
    expect(page.locator(".pixel-mark")).to_be_visible()
    page.keyboard.press("Enter")
    u, v = camera["width"] // 2 + 15, camera["height"] // 2 - 8
    where = page.locator(".answer .answer-head .figure")
    expect(where).to_have_text(re.compile(rf"Pixel {u}, {v} · frame \d+"))
    for _ in range(80):
        page.keyboard.press("ArrowLeft")
    page.keyboard.press("Enter")
    expect(where).to_have_text(re.compile(rf"Pixel 0, {v} "))
    page.get_by_role("button", name="Close answer").click()
    expect(page.locator(".answer")).to_be_hidden()
    expect(page.locator(".pixel-pick")).to_be_focused()


def test_an_obstacle_row_expands_to_the_figures_behind_its_reason(standing: Standing) -> None:
    page, told = standing()
    row = page.locator("observer-obstacles tbody tr").first
    why = page.locator("observer-obstacles tr.why").first
    expect(why).to_contain_text(told["obstacle"]["why"][:20])
    expect(why.locator("dl")).to_be_hidden()
    row.locator("td").first.click()
    expect(why.locator("dl")).to_contain_text("Significance")
    expect(row.get_by_role("button")).to_have_attribute("aria-expanded", "true")
    row.get_by_role("button").press("Escape")
    expect(why.locator("dl")).to_be_hidden()
    row.get_by_role("button").press("Enter")
    expect(why.locator("dl")).to_be_visible()


def test_camera_motion_is_shown(
    server: Server, open_panel: OpenPanel, keep_picture: KeepPicture
) -> None:
    before = server.get("/parameters")["values"]
    try:
        server.api.patch("/api/parameters", json={"ego_motion.model": "affine"}).raise_for_status()
        page = open_panel()
        page.get_by_role("tab", name="Status").click()
        shown = page.locator("observer-ego-motion")
        expect(shown).to_contain_text(
            re.compile(r"affine method over \d+ ms: \d+ of \d+ matches agree")
        )
        for term in ("Translation", "Rotation", "Shear", "Scale"):
            expect(shown.locator("dt", has_text=term).first).to_be_visible()
        expect(shown).to_contain_text(re.compile(r"−?\d+\.\d, −?\d+\.\d, −?\d+\.\d mm"))
        shown.scroll_into_view_if_needed()
        keep_picture(page, "camera-motion")
    finally:
        server.api.patch("/api/parameters", json=before).raise_for_status()


def test_an_answer_fits_on_a_phone(
    server: Server, standing: Standing, keep_picture: KeepPicture
) -> None:
    page, told = standing(viewport={"width": 360, "height": 780}, has_touch=True)
    _click(page, told["u"], told["v"], server.get("/status")["camera"])
    card = page.locator(".answer")
    expect(card).to_be_visible()
    box = card.bounding_box()
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= 360
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    keep_picture(page, "phone-answer")
