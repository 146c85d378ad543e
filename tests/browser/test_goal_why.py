"""What the page says about a goal and, on a click, why: faked, live, and in a recorded run."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import ViewportSize, expect

from .axe import findings
from .conftest import TOO_WIDE, KeepPicture, OpenPanel, Server, looks
from .goal_steps import DRIVEN_S, goal_section, on_robots_tab, open_source, until_driving

# An obstacle moves back and forth across the path to the goal.
_CROSSING = """\
based_on: drive
title: A room with somebody in the way
help: A P3-DX goes to and fro in front of the observer.
camera: {width: 320, height: 160}
robots:
  - name: P3-DX
    x: 2.3
    y: 0.9
    heading_deg: -90
    size: [0.455, 0.381, 0.33]
    motion:
      kind: course
      after: back
      acceleration: 0.8
      legs:
        - {kind: drive, distance_m: 1.8, speed: 0.5}
texture: {robot: red}
"""
_RATE = 0.6
# Small enough that the goal's panel is in the picture.
_SMALL: ViewportSize = {"width": 980, "height": 620}
_DESKTOP: ViewportSize = {"width": 1440, "height": 900}
_PHONE: ViewportSize = {"width": 390, "height": 844}
_NARROWEST = 360
# Make the page receive this goal as if from the server.
_TELL = """{
  const { parse } = JSON;
  JSON.parse = (text, ...more) => {
    const message = parse(text, ...more);
    if (message?.type === "robots" && window.toldGoal) message.goal = window.toldGoal;
    return message;
  };
}"""
_TOLD = {
    "state": "driving",
    "sentence": "Passing behind obstacle 3.",
    "place": [2.3, -0.4],
    "distance_m": 2.33,
    "elapsed_s": 67.9,
    "path": [],
    "risk_per_metre": 0.001,
    "planned_risk_per_metre": 0.0002,
    "waits_for": 3,
    "meets_s": 1.4,
    "meets_at": [0.9, 0.1],
    "refused": [
        {
            "direction": 0.0, "speed_mps": 0.5, "path": [[0.1, 0.0], [2.0, 0.0]], "cause": "risk",
            "risk": 0.0412, "track": 3, "meets_s": 1.4, "guard": None,
        },
        {
            "direction": 0.79, "speed_mps": 0.3, "path": [[0.1, 0.0], [1.0, 1.0]],
            "cause": "guard", "risk": None, "track": None, "meets_s": None,
            "guard": "obstacle 2 is within the stopping distance",
        },
    ],
}  # fmt: skip


@pytest.mark.parametrize("look", looks("phone"))
def test_every_goal_state_is_shown_and_accessible(
    open_panel: OpenPanel, keep_picture: KeepPicture, look: str
) -> None:
    options: Any = (
        {"viewport": _PHONE, "has_touch": True} if look == "phone" else {"color_scheme": look}
    )
    page = on_robots_tab(open_panel(script=_TELL, **options))
    section = goal_section(page)
    section.get_by_text("Advanced").click()
    driving, ended = section.locator(".goal-driving"), section.locator(".goal-ended")

    def check(state: str, **changes: Any) -> None:
        page.evaluate("(goal) => { window.toldGoal = goal; }", {**_TOLD, "state": state, **changes})
        expect(driving).to_be_visible(visible=state == "driving")
        expect(ended).to_be_visible(visible=state != "driving")
        section.locator("h3").scroll_into_view_if_needed()
        assert findings(page) == []
        keep_picture(page, f"goal-{state}-{look}")
        if look == "phone":
            page.set_viewport_size({**_PHONE, "width": _NARROWEST})
            assert page.evaluate(TOO_WIDE) == []
            page.set_viewport_size(_PHONE)

    check("driving")
    expect(driving).to_contain_text("Passing behind obstacle 3.")
    expect(driving).to_contain_text("2.3 m to go · 1:08")
    expect(section.locator("[role=status].visually-hidden")).to_have_text(
        "Passing behind obstacle 3."
    )
    why, refused = (
        driving.locator("observer-goal-explanation"),
        driving.locator(".refused-paths li"),
    )
    expect(why).to_be_hidden()
    # By keyboard, starting from the button above it.
    driving.get_by_role("button", name="Cancel goal").focus()
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    expect(why).to_contain_text("obstacle 3: driving straight on, the robot would meet it in 1.4 s")
    expect(why).to_contain_text("0.001 accepted, 0.0002 planned")
    expect(refused).to_have_text(
        [
            "Left by 45° at 0.3 m/s: rejected by the guard, obstacle 2 is within the stopping "
            "distance.",
            "Straight on at 0.5 m/s: would meet obstacle 3 in 1.4 s (risk per metre 0.04).",
        ]
    )
    check("driving", sentence="Waiting for obstacle 3: it would cross in 1.4 s.")
    refused.last.scroll_into_view_if_needed()
    keep_picture(page, f"goal-why-{look}")
    check("driving", refused=[], waits_for=None)
    expect(why).to_contain_text("no obstacle")
    expect(why).to_contain_text("No path was rejected.")
    check("ended", sentence="The goal was aborted: the robot no longer reports odometry.")
    expect(ended).to_contain_text("no longer reports odometry")
    check("reached", sentence="The goal is reached.")


@pytest.fixture
def crossing(server: Server, tmp_path: Path) -> Iterator[Server]:
    """A scene with an obstacle in the way; the lab is opened again for other tests."""
    scenario = tmp_path / "crossing.yaml"
    scenario.write_text(_CROSSING)
    open_source(server, f"simulated:{scenario}")
    server.api.post("/api/playback", json={"rate": _RATE}).raise_for_status()
    server.api.post("/api/robots/reset").raise_for_status()
    yield server
    server.api.post("/api/robots/stop").raise_for_status()
    server.api.post("/api/robots/reset").raise_for_status()
    run = server.get("/status")["run"]
    if run:
        server.api.post(f"/api/runs/{run['id']}/stop").raise_for_status()
    for kept in server.get("/history")["runs"]:
        if "crossing" in kept["source"]:
            server.api.delete(f"/api/runs/{kept['id']}").raise_for_status()
    open_source(server, "simulated:lab")
    server.api.post("/api/playback", json={"rate": 1.0}).raise_for_status()


def test_a_person_in_the_path_is_reported_live_and_in_the_run(
    crossing: Server, open_panel: OpenPanel, keep_picture: KeepPicture
) -> None:
    page = on_robots_tab(open_panel(refusals=True, viewport=_SMALL))
    section = goal_section(page)
    section.get_by_label("Ahead (m)").fill("4.5")
    send = section.get_by_role("button", name="Drive there")
    # Open before the goal is sent: on a slow machine the drive lasts only moments.
    section.locator("details", has=page.locator("observer-goal-explanation")).evaluate(
        "e => e.open = true"
    )
    run = crossing.api.post("/api/runs", json={"record": "none"}).json()["id"]
    refused = section.locator(".refused-paths li")
    deadline = time.monotonic() + DRIVEN_S
    while not refused.first.is_visible():
        assert time.monotonic() < deadline, section.inner_text()
        until_driving(page, send.click)
        page.wait_for_timeout(100)
    keep_picture(page, "goal-refused")
    crossing.api.post("/api/robots/stop").raise_for_status()
    crossing.api.post(f"/api/runs/{run}/stop").raise_for_status()

    page.set_viewport_size(_DESKTOP)
    page.evaluate("(run) => { location.hash = `#runs/${run}`; }", run)
    told, slider = page.locator("observer-run-goal"), page.locator("#player-frame")
    expect(slider).to_be_enabled(timeout=60_000)
    frames = crossing.get(f"/runs/{run}/frames")["frames"]
    expect(told).to_contain_text("s: no goal.")
    above = page.locator("observer-top-view")
    expect(above.locator(".goal")).to_have_count(0)
    goals = {at: entry["goal"] for at, entry in enumerate(frames) if entry["goal"]}
    at, goal = next((at, goal) for at, goal in goals.items() if goal["refused"])
    slider.fill(str(at))
    expect(told).to_contain_text(f"s: {goal['sentence']}")
    expect(told.locator(".refused-paths li")).to_have_count(len(goal["refused"]))
    expect(told).to_contain_text("0.001 accepted")
    expect(above.locator(".goal")).to_be_visible()
    expect(above.locator(".planned-path")).to_have_count(1)
    expect(above).to_contain_text("Violet: goal and planned path.")
    told.scroll_into_view_if_needed()
    assert findings(page) == []
    keep_picture(page, "goal-run")
    # The same for the time read in the chart.
    slider.fill("0")
    expect(told).to_contain_text("s: no goal.")
    chart = page.locator("observer-run-chart .chart")
    chart.focus()
    for _ in range(60):
        page.keyboard.press("ArrowRight")
        if told.locator(".refused-paths li").first.is_visible():
            break
    expect(told.locator(".refused-paths li").first).to_contain_text("m/s: ")
