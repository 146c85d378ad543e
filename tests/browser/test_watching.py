"""What a newcomer sees first: the scene, the views, who moves and how fast."""

from __future__ import annotations

import re
from collections.abc import Callable

from playwright.sync_api import Page, expect

from .conftest import Eventually, KeepPicture, OpenPanel, Pixels, Server

_HEADLINE = re.compile(
    r"Obstacle \d+ moves at (\d+\.\d\d)( ± \d+\.\d\d)? m/s.*, \d+\.\d m .*"
    r" — ground truth \d\.\d\d m/s"
)


def test_scene_views_and_headline_show_the_moving_obstacle(
    server: Server,
    open_panel: OpenPanel,
    keep_picture: KeepPicture,
    eventually: Eventually,
    pixels: Pixels,
    wait_for_scene: Callable[[Page], None],
) -> None:
    page = open_panel(viewer=True, color_scheme="light")
    line = page.locator(".headline-text")
    expect(line).to_have_text(_HEADLINE, timeout=30_000)
    speed = float(_HEADLINE.search(line.inner_text()).group(1))
    assert 0.0 < speed < 3.0
    wait_for_scene(page)
    # The viewer's own panel is hidden; our page has its own.
    viewer = page.frame(url=re.compile("/viewer/"))
    assert viewer.locator(".mantine-Paper-root:visible").count() == 0

    for name in ("left", "residual"):
        canvas = page.locator(f'observer-live-view[data-view="{name}"] canvas')
        assert pixels(canvas).std() > 8, name
    row = page.locator("observer-obstacles tbody tr").first
    expect(row).to_contain_text(re.compile(r"\d\.\d\d$"))
    assert page.locator("observer-speed-chart .uplot canvas").count() == 1
    keep_picture(page, "desktop-light")

    # Painted frames are acknowledged, from which the server measures the latency.
    eventually(lambda: server.get("/status")["latency_ms"]["count"] > 0)
    page.emulate_media(color_scheme="dark")
    # For the screenshot only: the scene adopts the colours in its next frames.
    page.wait_for_timeout(400)
    keep_picture(page, "desktop-dark")


def test_chosen_views_survive_a_reload(open_panel: OpenPanel, keep_picture: KeepPicture) -> None:
    page = open_panel()
    for name in ("warped", "disparity"):
        page.locator(f"input[name=view][value={name}]").check()
    page.locator("input[name=view][value=left]").uncheck()
    shown = page.locator("observer-live-view")
    assert [view.get_attribute("data-view") for view in shown.all()] == [
        "warped",
        "disparity",
        "residual",
    ]
    for name in ("warped", "disparity", "residual"):
        fresh = page.locator(f'observer-live-view[data-view="{name}"][data-freshness="fresh"]')
        expect(fresh).to_be_visible(timeout=10_000)
    keep_picture(page, "views")
    page.reload()
    expect(page.locator("observer-live-view")).to_have_count(3)


def test_playback_pauses_steps_and_resumes(
    server: Server, open_panel: OpenPanel, eventually: Eventually
) -> None:
    page = open_panel()
    page.get_by_role("button", name="Pause").click()
    eventually(lambda: server.get("/status")["playback"]["paused"])
    expect(page.locator("html")).to_have_attribute("data-freshness", "held", timeout=5_000)
    # Near the beginning, because a phone cuts off the end.
    context = page.locator(".headline-context")
    expect(context).to_have_text(re.compile(r"^simulated:lab · paused at frame \d+ · "))
    before = server.get("/status")["playback"]["frame"]
    page.get_by_role("button", name="Step forward").click()
    eventually(lambda: server.get("/status")["playback"]["frame"] == before + 1)
    page.get_by_role("spinbutton", name="Playback rate").fill("2")
    page.keyboard.press("Enter")
    eventually(lambda: server.get("/status")["playback"]["rate"] == 2)
    page.get_by_role("spinbutton", name="Playback rate").fill("1")
    page.keyboard.press("Enter")
    page.get_by_role("button", name="Play", exact=True).click()
    expect(page.locator("html")).to_have_attribute("data-freshness", "fresh", timeout=5_000)
    eventually(lambda: server.get("/status")["playback"]["rate"] == 1)


def test_a_missing_source_is_refused_next_to_its_field(
    server: Server, open_panel: OpenPanel
) -> None:
    page = open_panel(refusals=True)
    page.get_by_role("tab", name="Source").click()
    expect(page.locator(".source[aria-current=true] b")).to_have_text("The lab")
    field = page.get_by_label("Source", exact=True).and_(page.locator("input"))
    field.fill("/there/is/nothing")
    page.get_by_role("button", name="Open", exact=True).click()
    expect(page.locator("#source-error")).to_contain_text("/there/is/nothing", timeout=10_000)
    expect(field).to_have_attribute("aria-invalid", "true")
    assert server.get("/status")["source"]["spec"] == "simulated:lab"
