"""Manual driving on the page: holding, releasing, and how soon the robot is sent zero.

The robots are simulated but driven by the same code as real ones. "Zero" is when the drive process
reports that it sends zero; it is polled over another connection.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

from playwright.sync_api import Page, expect

from ..conftest import KeepPicture, Server
from ..road import Road
from ..witness import Witness, report
from .steps import Seat, drive, open_run_options, press_pad

_BUSY = """() => void setTimeout(() => {
  const end = performance.now() + 1200;
  while (performance.now() < end);
})"""
# The commands of 400 ms are lost on the way.
_INTERRUPT = """() => {
  const { send } = WebSocket.prototype;
  WebSocket.prototype.send = function (message) {
    if (!String(message).includes('"drive"')) send.call(this, message);
  };
  setTimeout(() => { WebSocket.prototype.send = send; }, 400);
}"""
_FAKE_GAMEPAD = """() => {
  const buttons = Array.from({ length: 17 }, () => ({ pressed: false, value: 0 }));
  window.fakePad = { index: 0, connected: true, mapping: "standard", axes: [0, 0, 0, 0], buttons };
  Object.defineProperty(navigator, "getGamepads", { value: () => [window.fakePad] });
  window.dispatchEvent(new Event("gamepadconnected"));
}"""


def test_the_pad_drives_while_it_is_held(
    room: Server, seat: Seat, keep_picture: KeepPicture
) -> None:
    page = seat()
    took = []
    with Witness(room) as witness:
        for right in (0.5, 0.7):
            drive(page, witness, partial(press_pad, page, right), page.mouse.up)
            start = time.monotonic()
            page.mouse.up()
            took.append(witness.zero_after(start))
        report("pad let go", *took)
        for kind in ("pointercancel", "contextmenu"):
            drive(page, witness, lambda: press_pad(page, 0.75), page.mouse.up)
            expect(page.locator(".drive-sent")).to_contain_text("to the right")
            if kind == "contextmenu":
                keep_picture(page, "driving")
                page.mouse.up()
                drive(page, witness, lambda: press_pad(page, 0.75), page.mouse.up)
            start = time.monotonic()
            page.locator(".drive-pad").evaluate(
                "(pad, kind) => pad.dispatchEvent(new PointerEvent(kind, { pointerId: 1 }))", kind
            )
            report(f"pad at {kind}", witness.zero_after(start))
            # Still pressed, but the hold was released.
            page.mouse.move(700, 500)
            witness.stays_zero(0.2)
            page.mouse.up()


def test_the_pad_is_steered_by_the_finger_though_the_page_moves_it(seat: Seat) -> None:
    page = seat()
    knob = page.locator(".pad-knob")
    box = page.locator(".drive-pad").bounding_box()
    assert box is not None
    x, y = box["x"] + 0.7 * box["width"], box["y"] + 0.4 * box["height"]
    page.mouse.move(x, y)
    page.mouse.down()
    held = knob.evaluate("knob => knob.style.cssText")
    # As a longer reason above it does.
    page.locator(".robot-actions").evaluate("part => { part.style.paddingTop = '60px'; }")
    for along in (x + 5, x):
        page.mouse.move(along, y)
    assert knob.evaluate("knob => knob.style.cssText") == held
    page.mouse.up()


def test_a_held_pad_says_why_the_robot_stands(room: Server, seat: Seat) -> None:
    page = seat(viewport={"width": 844, "height": 390}, has_touch=True)
    state = page.locator(".pad-state")
    page.locator(".drive-pad").evaluate("pad => pad.scrollIntoView({ block: 'nearest' })")
    with Witness(room) as witness:
        drive(page, witness, partial(press_pad, page), page.mouse.up)
        expect(state).to_have_text("Driving the obstacle")
        page.evaluate(_INTERRUPT)
        expect(state).to_have_text(
            "Driving was interrupted: release the controls once, then continue."
        )
        expect(state).to_be_in_viewport()
        expect(page.locator(".drive-limit")).to_be_hidden()
        page.mouse.up()


def test_keys_drive_only_outside_text_fields(room: Server, seat: Seat) -> None:
    page = seat()
    with Witness(room) as witness:
        for key in ("w", "ArrowDown"):
            drive(
                page,
                witness,
                partial(page.keyboard.down, key),
                partial(page.keyboard.up, key),
            )
            start = time.monotonic()
            page.keyboard.up(key)
            report(f"key {key} let go", witness.zero_after(start))
        open_run_options(page)
        page.locator("#run-name").focus()
        page.keyboard.down("w")
        witness.stays_zero(0.3)
        page.keyboard.up("w")
        expect(page.locator("#run-name")).to_have_value("w")
        # Entering a field releases what is held.
        page.locator(".drive-pad").focus()
        drive(page, witness, lambda: page.keyboard.down("w"), lambda: page.keyboard.up("w"))
        start = time.monotonic()
        page.locator("#run-name").evaluate("field => field.focus()")
        report("field entered", witness.zero_after(start))


def test_a_gamepad_drives_while_its_shoulder_button_is_held(room: Server, seat: Seat) -> None:
    page = seat()
    page.evaluate(_FAKE_GAMEPAD)

    def shoulder(pressed: bool) -> None:
        page.evaluate("(pressed) => { fakePad.buttons[4].pressed = pressed; }", pressed)

    with Witness(room) as witness:
        page.evaluate("fakePad.axes[1] = -1")
        witness.stays_zero(0.2)
        drive(page, witness, lambda: shoulder(True), lambda: shoulder(False))
        start = time.monotonic()
        shoulder(False)
        report("shoulder button let go", witness.zero_after(start))
        drive(page, witness, lambda: shoulder(True), lambda: shoulder(False))
        start = time.monotonic()
        page.evaluate("fakePad.connected = false")
        report("gamepad disconnected", witness.zero_after(start))
        # Reconnected with its button still held, it moves nothing.
        page.evaluate("fakePad.connected = true")
        page.evaluate("void window.dispatchEvent(new Event('gamepadconnected'))")
        witness.stays_zero(0.3)


def test_leaving_the_page_stops_the_robot(
    room: Server, seat: Seat, hide_page: Callable[[Page, bool], None]
) -> None:
    page = seat()
    page.locator(".drive-pad").focus()

    def press() -> None:
        page.keyboard.down("w")

    def let_go() -> None:
        page.keyboard.up("w")

    with Witness(room) as witness:
        drive(page, witness, press, let_go)
        start = time.monotonic()
        page.evaluate("void window.dispatchEvent(new Event('blur'))")
        report("page blurred", witness.zero_after(start))
        let_go()

        drive(page, witness, press, let_go)
        start = time.monotonic()
        hide_page(page, True)
        report("page hidden", witness.zero_after(start))
        witness.stays_zero(0.3)
        # Coming back does not restart it, though the key is still down.
        hide_page(page, False)
        witness.stays_zero(0.4)
        let_go()

        drive(page, witness, press, let_go)
        start = time.monotonic()
        page.evaluate(_BUSY)
        report("page held up", witness.zero_after(start))
        page.wait_for_timeout(100)
        witness.stays_zero(0.3)
        let_go()

        drive(page, witness, press, let_go)
        start = time.monotonic()
        page.close()
        report("page closed", witness.zero_after(start))
        witness.stays_zero(0.3)


def test_a_slow_link_stops_the_robot_and_is_reported(room: Server, seat: Seat) -> None:
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


def test_touch_drives_on_a_phone(room: Server, seat: Seat, keep_picture: KeepPicture) -> None:
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
        drive(page, witness, lambda: touch("touchStart", point), lambda: touch("touchEnd"))
        keep_picture(page, "phone-driving")
        touch("touchEnd")
        drive(page, witness, lambda: touch("touchStart", point), lambda: touch("touchEnd"))
        start = time.monotonic()
        touch("touchEnd")
        report("finger lifted", witness.zero_after(start))
    expect(page.locator("#stop-robots")).to_be_in_viewport()
