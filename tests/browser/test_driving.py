"""Driving by hand on the page: what holds, what lets go, and how soon the robot is told zero.

The robots are those of the simulated lab, driven by the very way of real ones. "Zero" is when the
drive process says that it sends zero; it is asked all the time from another connection.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import httpx
import pytest
from playwright.sync_api import Locator, Page, WebSocketRoute, expect

pytestmark = pytest.mark.browser

_WITHIN_S = 0.3
# How long asking and being answered may take on a machine that does other things as well.
_ASKING_S = 0.1
_ASK_EVERY_S = 0.01
_FAKE_GAMEPAD = """() => {
  const buttons = Array.from({ length: 17 }, () => ({ pressed: false, value: 0 }));
  window.fakePad = { index: 0, connected: true, mapping: "standard", axes: [0, 0, 0, 0], buttons };
  Object.defineProperty(navigator, "getGamepads", { value: () => [window.fakePad] });
  window.dispatchEvent(new Event("gamepadconnected"));
}"""
_ASK = """import("/static/app/notice.js").then((notice) => {
  notice.confirmed("Are you sure?", "It is only a test.", "Do it");
})"""
_HIDE = """(hidden) => {
  Object.defineProperty(document, "hidden", { value: hidden, configurable: true });
  document.dispatchEvent(new Event("visibilitychange"));
}"""


class Witness:
    """Asks the server again and again what goes to a robot."""

    def __init__(self, api: httpx.Client, role: str) -> None:
        self._api = api
        self._role = role
        self._ended = threading.Event()
        self._said: list[tuple[float, float]] = []
        self._thread = threading.Thread(target=self._ask)

    def _ask(self) -> None:
        while not self._ended.wait(_ASK_EVERY_S):
            robot = self._api.get("/api/robots").json()["robots"][self._role]
            sent = robot["sent"] if robot else {"speed_mps": 0, "turn_rate_radps": 0}
            moves = abs(sent["speed_mps"]) + abs(sent["turn_rate_radps"])
            self._said.append((time.monotonic(), moves))

    def __enter__(self) -> Witness:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def moving(self, within_s: float = 3.0) -> None:
        """Wait until it is sent something."""
        self._wait(lambda moves: moves > 0, time.monotonic(), within_s, "it did not move")

    def zero_after(self, start: float, within_s: float = 3.0) -> float:
        """How long after ``start`` it was sent zero."""
        return self._wait(lambda moves: moves == 0, start, within_s, "it was not stopped") - start

    def stays_zero(self, for_s: float) -> None:
        start = time.monotonic()
        time.sleep(for_s)
        assert all(moves == 0 for at, moves in self._said if at >= start)

    def _wait(
        self, fits: Callable[[float], bool], start: float, within_s: float, otherwise: str
    ) -> float:
        while time.monotonic() < start + within_s:
            for at, moves in tuple(self._said[-50:]):
                if at >= start and fits(moves):
                    return at
            time.sleep(0.005)
        pytest.fail(f"{otherwise} within {within_s} s")


@pytest.fixture(scope="module")
def room(server) -> Iterator[Any]:
    """The server on a simulated room in which there is space to drive."""
    server.api.put("/api/source", json={"source": "simulated:drive"}).raise_for_status()
    deadline = time.monotonic() + 20
    while not _all_disarmed(server):
        assert time.monotonic() < deadline, server.get("/robots")
        time.sleep(0.1)
    yield server
    server.api.put("/api/source", json={"source": "simulated:lab"}).raise_for_status()


def _all_disarmed(server) -> bool:
    robots = server.get("/robots")["robots"].values()
    return all(robot and robot["state"] == "disarmed" for robot in robots)


@pytest.fixture(autouse=True)
def _begin_at_rest(room) -> None:
    room.api.post("/api/robots/stop").raise_for_status()
    room.api.post("/api/robots/reset").raise_for_status()


@pytest.fixture
def seat(open_panel) -> Callable[..., Page]:
    """A page on the robots' tab with a role chosen; ``armed`` arms it as well."""

    def sit(
        role: str = "obstacle",
        *,
        armed: bool = True,
        before: Callable[[Page], object] = lambda _: None,
        **options: Any,
    ) -> Page:
        page = open_panel(**options)
        before(page)
        page.get_by_role("tab", name="Robots").click()
        page.locator(f"input[name=drive-role][value={role}]").check(force=True)
        if armed:
            page.get_by_role("button", name="Arm", exact=True).click()
            expect(_card(page, role).locator(".state-chip")).to_have_text("Armed")
            expect(page.locator(".pad-state")).to_contain_text("Ready")
        return page

    return sit


def _card(page: Page, role: str) -> Locator:
    return page.locator(f".role-card:has([value={role}])")


def _press_pad(page: Page, right: float = 0.5, down: float = 0.05) -> None:
    """Hold the pad at a place, 0 to 1 of its width and height."""
    box = page.locator(".drive-pad").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + right * box["width"], box["y"] + down * box["height"])
    page.mouse.down()


def _report(what: str, seconds: list[float]) -> None:
    sys.stdout.write(f"\n{what}: zero after {1000 * max(seconds):.0f} ms at worst\n")
    assert max(seconds) <= _WITHIN_S + _ASKING_S, what


def test_the_pad_drives_while_it_is_held(room, seat, keep_picture):
    page = seat()
    took = []
    with Witness(room.api, "obstacle") as witness:
        for _ in range(3):
            _press_pad(page)
            witness.moving()
            start = time.monotonic()
            page.mouse.up()
            took.append(witness.zero_after(start))
        _press_pad(page, right=0.9, down=0.1)
        witness.moving()
        expect(page.locator(".drive-sent")).to_contain_text("to the right")
        keep_picture(page, "driving")
        for kind in ("pointercancel", "contextmenu"):
            start = time.monotonic()
            page.locator(".drive-pad").dispatch_event(
                kind, {"pointerId": 1, "bubbles": True, "cancelable": True}
            )
            took.append(witness.zero_after(start))
            # Still pressed, but that was let go.
            page.mouse.move(700, 500)
            witness.stays_zero(0.3)
            page.mouse.up()
            if kind == "pointercancel":
                _press_pad(page)
                witness.moving()
    _report("pad let go", took)


def test_keys_drive_only_where_nobody_types(room, seat):
    page = seat()
    took = []
    with Witness(room.api, "obstacle") as witness:
        for key in ("w", "ArrowUp"):
            page.keyboard.down(key)
            witness.moving()
            # What the keyboard repeats is no new press.
            page.keyboard.down(key)
            start = time.monotonic()
            page.keyboard.up(key)
            took.append(witness.zero_after(start))
        page.locator("#run-name").focus()
        page.keyboard.down("w")
        witness.stays_zero(0.4)
        page.keyboard.up("w")
        expect(page.locator("#run-name")).to_have_value("w")
        # What is held while a field is entered is let go.
        page.locator(".drive-pad").focus()
        page.keyboard.down("w")
        witness.moving()
        start = time.monotonic()
        page.locator("#run-name").focus()
        took.append(witness.zero_after(start))
        page.keyboard.up("w")
    _report("key let go", took)


@pytest.mark.parametrize("loss", ["blurred", "hidden", "frozen", "closed"])
def test_a_page_that_is_left_stops_the_robot(room, seat, loss):
    page = seat()
    with Witness(room.api, "obstacle") as witness:
        page.keyboard.down("w")
        witness.moving()
        start = time.monotonic()
        if loss == "blurred":
            page.evaluate("window.dispatchEvent(new Event('blur'))")
        elif loss == "hidden":
            page.evaluate(_HIDE, True)
        elif loss == "frozen":
            freezer = page.context.new_cdp_session(page)
            freezer.send("Page.setWebLifecycleState", {"state": "frozen"})
        else:
            page.close()
        took = witness.zero_after(start)
        _report(f"page {loss}", [took])
        witness.stays_zero(0.5)
        if loss == "hidden":
            # Coming back restarts nothing, though the key is still down.
            page.evaluate(_HIDE, False)
            witness.stays_zero(0.5)
            page.keyboard.up("w")
            page.keyboard.down("w")
            witness.moving()


def test_the_second_operator_takes_over_and_the_first_is_told(room, seat):
    first = seat()
    second = seat(armed=False, refusals=True)
    card = _card(second, "obstacle")
    expect(card).to_contain_text("drives it")
    expect(second.get_by_role("button", name="Arm", exact=True)).to_be_hidden()
    with Witness(room.api, "obstacle") as witness:
        first.keyboard.down("w")
        witness.moving()
        start = time.monotonic()
        second.get_by_role("button", name="Take over").click()
        took = witness.zero_after(start)
        # The first one's key is still down, and moves nothing.
        witness.stays_zero(0.5)
        expect(card).to_contain_text("You drive it")
        expect(_card(first, "obstacle")).not_to_contain_text("You drive it")
        expect(first.get_by_role("button", name="Take over")).to_be_visible()
        first.keyboard.up("w")
        second.get_by_role("button", name="Arm", exact=True).click()
        expect(second.locator(".pad-state")).to_contain_text("Ready")
        second.keyboard.down("w")
        witness.moving()
        # Whoever looks on may stop it.
        start = time.monotonic()
        first.get_by_role("button", name="Stop robots").click()
        stopped = witness.zero_after(start)
        second.keyboard.up("w")
    expect(second.locator(".stop-state")).to_contain_text("Stopped by")
    _report("taken over", [took])
    _report("stopped by somebody else", [stopped])


def test_space_and_esc_stop_wherever_one_is(room, seat, keep_picture):
    page = seat()
    took = []
    places = {
        "Space": lambda: page.locator("#run-name").focus(),
        "Escape": lambda: page.get_by_role("button", name="Disarm").focus(),
    }
    with Witness(room.api, "obstacle") as witness:
        for key, go in places.items():
            page.locator(".drive-pad").focus()
            _press_pad(page)
            witness.moving()
            start = time.monotonic()
            page.keyboard.press(key)
            took.append(witness.zero_after(start))
            page.mouse.up()
            expect(page.locator(".stop-state")).to_contain_text("Stopped by")
            page.get_by_role("button", name="Reset").click()
            expect(page.locator(".stop-latched")).to_be_hidden()
            # Nothing starts by itself; armed again, the key stops from within a field too.
            page.get_by_role("button", name="Arm", exact=True).click()
            expect(page.locator(".stop-keys")).to_contain_text("always stop")
            go()
            page.keyboard.press(key)
            expect(page.locator(".stop-state")).to_contain_text("Stopped by")
            expect(page.locator("#run-name")).to_have_value("")
            keep_picture(page, "driving-stopped")
            page.get_by_role("button", name="Reset").click()
            expect(page.locator(".stop-latched")).to_be_hidden()
            page.get_by_role("button", name="Arm", exact=True).click()
            expect(page.locator(".pad-state")).to_contain_text("Ready")
        # In the wizard and over a question as well.
        page.get_by_role("tab", name="Runs").click()
        page.keyboard.press("Escape")
        expect(page.locator(".stop-state")).to_contain_text("Stopped by")
    _report("stop by key", took)


def test_the_keys_keep_their_meaning_while_nothing_is_armed(seat):
    page = seat(armed=False)
    page.locator("#run-name").fill("")
    page.locator("#run-name").press("Space")
    expect(page.locator("#run-name")).to_have_value(" ")
    page.get_by_text("Port and model").focus()
    page.keyboard.press("Space")
    expect(page.locator("#robot-port")).to_be_visible()
    expect(page.locator(".stop-latched")).to_be_hidden()
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("Space")
    expect(page.locator(".stop-state")).to_contain_text("Stopped by")


def test_the_wizard_and_its_questions_have_the_stop_button(seat):
    page = seat()
    page.get_by_role("tab", name="Calibration").click()
    page.get_by_role("button", name="Calibrate", exact=False).first.click()
    expect(page.locator("observer-calibration-wizard")).to_be_visible()
    page.evaluate(_ASK)
    over = page.locator("dialog").get_by_role("button", name="Stop robots")
    over.click()
    expect(page.locator(".stop-state")).to_contain_text("Stopped by")
    page.locator("dialog").get_by_role("button", name="Keep").click()
    expect(page.locator("#stop-robots")).to_be_in_viewport()


class Road:
    """The drive socket's way through the test, which can delay both directions or lose all."""

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

    def go_on(self, for_s: float) -> None:
        """Let time pass."""
        end = time.monotonic() + for_s
        while time.monotonic() < end:
            while self._waiting and self._waiting[0][0] <= time.monotonic():
                self._waiting.pop(0)[1]()
            self._page.wait_for_timeout(10)


def test_a_slow_link_stops_and_says_so(room, seat):
    roads: list[Road] = []
    page = seat(before=lambda page: roads.append(Road(page)))
    road = roads[0]
    with Witness(room.api, "obstacle") as witness:
        page.keyboard.down("w")
        witness.moving()
        start = time.monotonic()
        road.delay_s = 0.4
        road.go_on(1.5)
        _report("link too slow", [witness.zero_after(start)])
        expect(page.locator("observer-drive-pad")).to_contain_text("link too slow")
        road.delay_s = 0
        road.go_on(1.5)
        # The link is good again and the key still down: nothing moves until it is pressed anew.
        witness.stays_zero(0.3)
        page.keyboard.up("w")
        road.go_on(0.5)
        page.keyboard.down("w")
        road.go_on(0.3)
        witness.moving()
        start = time.monotonic()
        road.lost = True
        road.go_on(0.6)
        _report("link lost", [witness.zero_after(start)])


def test_a_gamepad_drives_while_its_shoulder_button_is_held(room, seat):
    page = seat()
    page.evaluate(_FAKE_GAMEPAD)
    took = []
    with Witness(room.api, "obstacle") as witness:
        page.evaluate("window.fakePad.axes[1] = -1")
        witness.stays_zero(0.3)
        page.evaluate("window.fakePad.buttons[4].pressed = true")
        witness.moving()
        start = time.monotonic()
        page.evaluate("window.fakePad.buttons[4].pressed = false")
        took.append(witness.zero_after(start))
        page.evaluate("window.fakePad.buttons[4].pressed = true")
        witness.moving()
        start = time.monotonic()
        page.evaluate("window.fakePad.connected = false")
        took.append(witness.zero_after(start))
        # Found again with its button still held, it moves nothing.
        page.evaluate("window.fakePad.connected = true")
        page.evaluate("window.dispatchEvent(new Event('gamepadconnected'))")
        witness.stays_zero(0.4)
    _report("gamepad let go", took)


def test_the_observer_is_driven_on_a_phone(room, seat, keep_picture):
    phone = {"viewport": {"width": 360, "height": 780}, "has_touch": True}
    page = seat("observer", **phone)
    expect(page.locator("#stop-robots")).to_be_in_viewport()
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    pad = page.locator(".drive-pad")
    pad.scroll_into_view_if_needed()
    box = pad.bounding_box()
    touch = page.context.new_cdp_session(page)
    point = {"x": box["x"] + box["width"] / 2, "y": box["y"] + 0.2 * box["height"]}
    with Witness(room.api, "observer") as witness:
        touch.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [point]})
        witness.moving()
        expect(page.locator(".guard-words")).to_contain_text("Guard: ")
        page.wait_for_timeout(600)
        keep_picture(page, "phone-driving")
        start = time.monotonic()
        touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
        took = witness.zero_after(start)
    _report("finger lifted", [took])
    expect(page.locator("#stop-robots")).to_be_in_viewport()


def test_a_programme_runs_while_its_operator_is_there(room, seat):
    page = seat()
    both = page.locator("[data-programme=figure17_a]")
    expect(both.get_by_role("button", name="Start")).to_be_disabled()
    expect(both).to_contain_text("First arm the observer")
    page.locator("input[name=drive-role][value=observer]").check(force=True)
    page.get_by_role("button", name="Arm", exact=True).click()
    both.get_by_role("button", name="Start").click()
    with Witness(room.api, "obstacle") as witness:
        witness.moving(8.0)
        expect(page.locator(".programme-running progress")).to_be_visible()
        start = time.monotonic()
        page.evaluate(_HIDE, True)
        took = witness.zero_after(start)
    # Presence ends with the page being seen.
    _report("programme without its operator", [took])
    page.evaluate(_HIDE, False)
    expect(page.locator(".programme-running")).to_be_hidden()
