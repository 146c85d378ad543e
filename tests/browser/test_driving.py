"""Manual driving on the page: holding, releasing, and how soon the robot is sent zero.

The robots are simulated but driven by the same code as real ones. "Zero" is when the drive process
reports that it sends zero; it is polled over another connection.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import pytest
from playwright.sync_api import Locator, Page, expect

from .conftest import Eventually, KeepPicture, OpenPanel, Server
from .road import Road
from .witness import TRIES, Witness, report

_BUSY = """() => void setTimeout(() => {
  const end = performance.now() + 1200;
  while (performance.now() < end);
})"""
# Record when the page asks for control, ms since the epoch.
_NOTE_WHEN_ASKED = """() => {
  const { send } = WebSocket.prototype;
  WebSocket.prototype.send = function (message) {
    if (String(message).includes('"take"')) window.askedAt = Date.now();
    send.call(this, message);
  };
}"""
_FAKE_GAMEPAD = """() => {
  const buttons = Array.from({ length: 17 }, () => ({ pressed: false, value: 0 }));
  window.fakePad = { index: 0, connected: true, mapping: "standard", axes: [0, 0, 0, 0], buttons };
  Object.defineProperty(navigator, "getGamepads", { value: () => [window.fakePad] });
  window.dispatchEvent(new Event("gamepadconnected"));
}"""
_ASK = """import("/static/app/shell/notice.js").then((notice) => {
  notice.askConfirmation("Are you sure?", "It is only a test.", "Do it");
})"""


@pytest.fixture(scope="module")
def room(server: Server) -> Iterator[Server]:
    """The server on a simulated room with space to drive."""
    _until(lambda: _opened(server, "simulated:drive"))
    _until(lambda: _all_disarmed(server))
    # The obstacle needs no images: play slowly, to leave the processor to the page.
    _play(server, 0.2)
    yield server
    _until(lambda: _opened(server, "simulated:lab"))
    _play(server, 1.0)


def _until(is_so: Callable[[], bool], within_s: float = 60.0) -> None:
    deadline = time.monotonic() + within_s
    while not is_so():
        assert time.monotonic() < deadline, f"not within {within_s} s"
        time.sleep(0.05)


def _opened(server: Server, source: str) -> bool:
    """Return whether the source was opened; the engine may still be starting."""
    if server.api.put("/api/source", json={"source": source}).is_success:
        return True
    time.sleep(3.0)
    return False


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
def seat(open_panel: OpenPanel) -> Callable[..., Page]:
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
            _arm(page)
        return page

    return sit


def _arm(page: Page) -> None:
    page.get_by_role("button", name="Arm", exact=True).click()
    expect(_card(page).locator(".state-chip")).to_have_text("Armed")
    expect(page.locator(".pad-state")).to_contain_text("Ready")


def _card(page: Page, role: str = "obstacle") -> Locator:
    return page.locator(f".role-card:has([value={role}])")


def _open_run_options(page: Page) -> None:
    """Open a field to type in: that of a run's name."""
    if not page.locator("#run-name").is_visible():
        page.get_by_role("button", name="Run options").click()


def _press_pad(page: Page, right: float = 0.5, down: float = 0.15) -> None:
    """Hold the pad at a position, 0 to 1 of its width and height."""
    box = page.locator(".drive-pad").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + right * box["width"], box["y"] + down * box["height"])
    page.mouse.down()


def _drive(
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


def test_the_pad_drives_while_it_is_held(
    room: Server, seat: Callable[..., Page], keep_picture: KeepPicture
) -> None:
    page = seat()
    took = []
    with Witness(room) as witness:
        for right in (0.5, 0.7):
            _drive(page, witness, partial(_press_pad, page, right), page.mouse.up)
            start = time.monotonic()
            page.mouse.up()
            took.append(witness.zero_after(start))
        report("pad let go", *took)
        for kind in ("pointercancel", "contextmenu"):
            _drive(page, witness, lambda: _press_pad(page, 0.75), page.mouse.up)
            expect(page.locator(".drive-sent")).to_contain_text("to the right")
            if kind == "contextmenu":
                keep_picture(page, "driving")
                page.mouse.up()
                _drive(page, witness, lambda: _press_pad(page, 0.75), page.mouse.up)
            start = time.monotonic()
            page.locator(".drive-pad").evaluate(
                "(pad, kind) => pad.dispatchEvent(new PointerEvent(kind, { pointerId: 1 }))", kind
            )
            report(f"pad at {kind}", witness.zero_after(start))
            # Still pressed, but the hold was released.
            page.mouse.move(700, 500)
            witness.stays_zero(0.2)
            page.mouse.up()


def test_keys_drive_only_outside_text_fields(room: Server, seat: Callable[..., Page]) -> None:
    page = seat()
    with Witness(room) as witness:
        for key in ("w", "ArrowDown"):
            _drive(
                page,
                witness,
                partial(page.keyboard.down, key),
                partial(page.keyboard.up, key),
            )
            start = time.monotonic()
            page.keyboard.up(key)
            report(f"key {key} let go", witness.zero_after(start))
        _open_run_options(page)
        page.locator("#run-name").focus()
        page.keyboard.down("w")
        witness.stays_zero(0.3)
        page.keyboard.up("w")
        expect(page.locator("#run-name")).to_have_value("w")
        # Entering a field releases what is held.
        page.locator(".drive-pad").focus()
        _drive(page, witness, lambda: page.keyboard.down("w"), lambda: page.keyboard.up("w"))
        start = time.monotonic()
        page.locator("#run-name").evaluate("field => field.focus()")
        report("field entered", witness.zero_after(start))


def test_a_gamepad_drives_while_its_shoulder_button_is_held(
    room: Server, seat: Callable[..., Page]
) -> None:
    page = seat()
    page.evaluate(_FAKE_GAMEPAD)

    def shoulder(pressed: bool) -> None:
        page.evaluate("(pressed) => { fakePad.buttons[4].pressed = pressed; }", pressed)

    with Witness(room) as witness:
        page.evaluate("fakePad.axes[1] = -1")
        witness.stays_zero(0.2)
        _drive(page, witness, lambda: shoulder(True), lambda: shoulder(False))
        start = time.monotonic()
        shoulder(False)
        report("shoulder button let go", witness.zero_after(start))
        _drive(page, witness, lambda: shoulder(True), lambda: shoulder(False))
        start = time.monotonic()
        page.evaluate("fakePad.connected = false")
        report("gamepad disconnected", witness.zero_after(start))
        # Reconnected with its button still held, it moves nothing.
        page.evaluate("fakePad.connected = true")
        page.evaluate("void window.dispatchEvent(new Event('gamepadconnected'))")
        witness.stays_zero(0.3)


def test_leaving_the_page_stops_the_robot(
    room: Server, seat: Callable[..., Page], hide_page: Callable[[Page, bool], None]
) -> None:
    page = seat()
    page.locator(".drive-pad").focus()

    def press() -> None:
        page.keyboard.down("w")

    def let_go() -> None:
        page.keyboard.up("w")

    with Witness(room) as witness:
        _drive(page, witness, press, let_go)
        start = time.monotonic()
        page.evaluate("void window.dispatchEvent(new Event('blur'))")
        report("page blurred", witness.zero_after(start))
        let_go()

        _drive(page, witness, press, let_go)
        start = time.monotonic()
        hide_page(page, True)
        report("page hidden", witness.zero_after(start))
        witness.stays_zero(0.3)
        # Coming back does not restart it, though the key is still down.
        hide_page(page, False)
        witness.stays_zero(0.4)
        let_go()

        _drive(page, witness, press, let_go)
        start = time.monotonic()
        page.evaluate(_BUSY)
        report("page held up", witness.zero_after(start))
        page.wait_for_timeout(100)
        witness.stays_zero(0.3)
        let_go()

        _drive(page, witness, press, let_go)
        start = time.monotonic()
        page.close()
        report("page closed", witness.zero_after(start))
        witness.stays_zero(0.3)


def test_a_second_operator_takes_over_and_the_first_is_notified(
    room: Server, seat: Callable[..., Page], eventually: Eventually
) -> None:
    first = seat()
    second = seat(armed=False, refusals=True)
    expect(_card(second)).to_contain_text("has control")
    expect(second.get_by_role("button", name="Arm", exact=True)).to_be_hidden()
    with Witness(room) as witness:
        first.bring_to_front()
        _drive(first, witness, lambda: first.keyboard.down("w"), lambda: first.keyboard.up("w"))
        second.evaluate(_NOTE_WHEN_ASKED)
        second.get_by_role("button", name="Take control").evaluate("button => button.click()")
        asked = eventually(lambda: second.evaluate("window.askedAt ?? null")) / 1000
        # Not measured from the click, as the page may have to connect first.
        report("taken over", witness.zero_after(asked - time.time() + time.monotonic()))
        # The first page's key is still down and moves nothing.
        witness.stays_zero(0.4)
        expect(_card(second)).to_contain_text("You have control")
        expect(_card(first)).not_to_contain_text("You have control")
        expect(first.get_by_role("button", name="Take control")).to_be_visible()
        first.keyboard.up("w")
        second.bring_to_front()
        _arm(second)
        _drive(second, witness, lambda: second.keyboard.down("w"), lambda: second.keyboard.up("w"))
        # Any watcher may stop it.
        start = time.monotonic()
        first.locator("#stop-robots").evaluate("button => button.click()")
        report("stopped by somebody else", witness.zero_after(start))
    expect(second.locator(".stop-state")).to_contain_text("Stopped by")


def test_space_and_esc_stop_from_anywhere(
    room: Server, seat: Callable[..., Page], keep_picture: KeepPicture
) -> None:
    page = seat()
    latched = page.locator(".stop-latched")

    def reset() -> None:
        expect(latched).to_contain_text("Stopped by")
        page.get_by_role("button", name="Reset").click()
        expect(latched).to_be_hidden()

    with Witness(room) as witness:
        for key in ("Space", "Escape"):
            _drive(page, witness, lambda: _press_pad(page), page.mouse.up)
            start = time.monotonic()
            page.keyboard.press(key)
            report(f"{key} pressed", witness.zero_after(start))
            page.mouse.up()
            if key == "Space":
                expect(latched).to_be_visible()
                keep_picture(page, "driving-stopped")
            reset()
            # Nothing starts by itself; once armed again, the key stops even from within a field.
            witness.stays_zero(0.2)
            _arm(page)
            expect(page.locator(".stop-keys")).to_contain_text("always stop")
            _open_run_options(page)
            page.locator("#run-name").focus()
            page.keyboard.press(key)
            reset()
            expect(page.locator("#run-name")).to_have_value("")
            _arm(page)
    # Also over the wizard and a question, by their own buttons.
    page.get_by_role("tab", name="Calibration").click()
    page.locator("observer-calibration button", has_text="Calibrate").first.click()
    expect(page.locator("observer-calibration-wizard")).to_be_visible()
    expect(page.locator("#stop-robots")).to_be_in_viewport()
    page.evaluate(_ASK)
    page.locator("dialog").get_by_role("button", name="Stop robots").click()
    expect(latched).to_contain_text("Stopped by")
    page.locator("dialog").get_by_role("button", name="Cancel").click()


_HEADER_OVERLAPS = """() => {
  const parts = [...document.querySelectorAll(".header :is(a, button, label, .stop-state)")]
    .filter((part) => part.checkVisibility() && !part.closest(".menu-box"))
    .map((part) => [part.textContent.trim() || part.ariaLabel, part.getBoundingClientRect()]);
  return parts.flatMap(([name, a], at) =>
    parts
      .slice(at + 1)
      .filter(([, b]) => a.right - b.left > 2 && b.right - a.left > 2)
      .filter(([, b]) => a.bottom - b.top > 2 && b.bottom - a.top > 2)
      .map(([other]) => `${name} and ${other}`),
  );
}"""


def test_header_items_do_not_overlap_while_armed_or_stopped(
    seat: Callable[..., Page],
) -> None:
    page = seat()
    found = {}
    for state in ("armed", "stopped"):
        if state == "stopped":
            page.locator("#stop-robots").click()
            expect(page.locator(".stop-state")).to_contain_text("Stopped by")
        for width in (360, 390, 600, 820, 960, 1024, 1100, 1280, 1366, 1440, 1600, 1920, 2560):
            page.set_viewport_size({"width": width, "height": 900})
            found[state, width] = page.evaluate(_HEADER_OVERLAPS)
    assert not any(found.values()), found


_HEADER_PLACES = """() => [...document.querySelectorAll(".top :is(a, button, label)")]
  .filter((part) => part.checkVisibility() && !part.closest(".menu-box"))
  .map((part) => {
    const { left, top, width, height } = part.getBoundingClientRect();
    return [part.textContent.trim() || part.ariaLabel, left, top, width, height].join();
  })"""


@pytest.mark.parametrize("width", [1440, 1280, 1024, 390])
def test_stopping_twice_in_a_row_stays_stopped_and_moves_nothing_in_the_header(
    seat: Callable[..., Page], width: int
) -> None:
    page = seat()
    page.set_viewport_size({"width": width, "height": 900})
    before = page.evaluate(_HEADER_PLACES)
    stop = page.locator("#stop-robots").bounding_box()
    assert stop is not None
    at = (stop["x"] + stop["width"] / 2, stop["y"] + stop["height"] / 2)
    page.mouse.click(*at)
    expect(page.locator(".stop-state")).to_contain_text("Stopped by")
    reset = page.get_by_role("button", name="Reset", exact=True)
    expect(reset).to_be_disabled()
    assert page.evaluate(_HEADER_PLACES) == before
    page.mouse.click(*at)
    expect(reset).to_be_enabled(timeout=3_000)
    expect(page.locator(".stop-state")).to_contain_text("Stopped by")
    reset.click()
    expect(page.locator(".stop-latched")).to_be_hidden()
    # The hidden button does not take the keyboard's place with it.
    expect(page.locator("#stop-robots")).to_be_focused()
    assert page.evaluate(_HEADER_PLACES) == before


def test_esc_stops_while_armed_even_with_an_enlarged_view(seat: Callable[..., Page]) -> None:
    page = seat()
    view = page.locator('observer-live-view[data-view="left"]')
    view.get_by_role("button", name="Enlarge").click()
    page.keyboard.press("Escape")
    expect(page.locator(".stop-latched")).to_be_visible()
    expect(view).to_have_attribute("data-enlarged", "")
    # Nothing is armed any more.
    page.keyboard.press("Escape")
    expect(view).not_to_have_attribute("data-enlarged", "")


def test_keys_keep_their_usual_meaning_while_nothing_is_armed(seat: Callable[..., Page]) -> None:
    page = seat(armed=False)
    _open_run_options(page)
    page.locator("#run-name").press("Space")
    expect(page.locator("#run-name")).to_have_value(" ")
    page.get_by_text("Port and model").focus()
    page.keyboard.press("Space")
    expect(page.locator("#robot-port")).to_be_visible()
    expect(page.locator(".stop-latched")).to_be_hidden()
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("Space")
    expect(page.locator(".stop-state")).to_contain_text("Stopped by")


def test_a_slow_link_stops_the_robot_and_is_reported(
    room: Server, seat: Callable[..., Page]
) -> None:
    roads: list[Road] = []
    page = seat(before=lambda page: roads.append(Road(page)))
    road = roads[0]
    with Witness(room) as witness:
        road.drive(witness)
        start = time.monotonic()
        road.delay_s = 0.4
        road.go_on(1.2)
        report("connection too slow", witness.zero_after(start))
        expect(page.locator("observer-drive-pad")).to_contain_text("connection too slow")
        road.delay_s = 0
        good = page.locator("observer-drive-pad .state-chip", has_text="Link good")
        assert road.go_on(8.0, good.is_visible)
        # The link is good again and the key still down: nothing moves until it is pressed again.
        road.go_on(0.4)
        assert not witness.moves
        page.keyboard.up("w")
        road.drive(witness)
        start = time.monotonic()
        road.lost = True
        road.go_on(0.6)
        report("link lost", witness.zero_after(start))


def test_touch_drives_on_a_phone(
    room: Server, seat: Callable[..., Page], keep_picture: KeepPicture
) -> None:
    page = seat(viewport={"width": 360, "height": 780}, has_touch=True)
    expect(page.locator("#stop-robots")).to_be_in_viewport()
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    pad = page.locator(".drive-pad")
    pad.scroll_into_view_if_needed()
    box = pad.bounding_box()
    assert box is not None
    screen = page.context.new_cdp_session(page)
    point = {"x": box["x"] + box["width"] / 2, "y": box["y"] + 0.2 * box["height"]}

    def touch(kind: str, *points: dict[str, float]) -> None:
        screen.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": list(points)})

    with Witness(room) as witness:
        _drive(page, witness, lambda: touch("touchStart", point), lambda: touch("touchEnd"))
        keep_picture(page, "phone-driving")
        touch("touchEnd")
        _drive(page, witness, lambda: touch("touchStart", point), lambda: touch("touchEnd"))
        start = time.monotonic()
        touch("touchEnd")
        report("finger lifted", witness.zero_after(start))
    expect(page.locator("#stop-robots")).to_be_in_viewport()


def test_a_programme_runs_while_its_operator_is_present(
    room: Server, seat: Callable[..., Page], hide_page: Callable[[Page, bool], None]
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
    room: Server, seat: Callable[..., Page], keep_picture: KeepPicture
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
    _until(lambda: _speed(room) < 0.01, 10)
    _arm(page)
    _speed_up(page, room, "s")
    page.close()
    _until(lambda: room.get("/robots/check")["check"]["record"], 10)
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
