"""The system's Firefox for tests of the page, controlled by WebDriver BiDi over its websocket.

Playwright drives only its own build of Firefox, so this is the little that the tests need.
Headless Firefox has no WebGL (bugzilla.mozilla.org 1375585), so its window is on a virtual screen:
Xvfb.
"""

from __future__ import annotations

import base64
import json
import os
import re
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from websockets.sync.client import connect
from websockets.sync.connection import Connection

from app.client.server_process import ended_after

FIREFOX_NAMES = ("firefox-esr", "firefox")
_START_S = 60.0
_ANSWER_S = 60.0
_STOP_S = 10.0
# Software WebGL where there is no graphics card; no requests to the browser's vendor, in addition
# to what an automated browser switches off by itself.
_PREFERENCES = {
    "webgl.force-enabled": True,
    "browser.aboutwelcome.enabled": False,
    "datareporting.policy.dataSubmissionEnabled": False,
    "termsofuse.bypassNotification": True,
    "app.normandy.enabled": False,
    "browser.region.update.enabled": False,
    "network.captive-portal-service.enabled": False,
    "network.connectivity-service.enabled": False,
}
_EVENTS = ("log.entryAdded", "network.beforeRequestSent")


def firefox() -> str | None:
    """Return the path of the system's Firefox, if there is one and a screen for it."""
    found = next(filter(None, map(shutil.which, FIREFOX_NAMES)), None)
    return found if shutil.which("Xvfb") else None


class Tab:
    """A page in Firefox.

    Attributes:
        errors: errors logged to its console, and uncaught errors.
        requested: the addresses requested.
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._last = 0
        self.errors: list[str] = []
        self.requested: list[str] = []
        self.ask("session.new", capabilities={})
        self.ask("session.subscribe", events=list(_EVENTS))
        self._context = self.ask("browsingContext.getTree")["contexts"][0]["context"]

    def ask(self, method: str, **parameters: Any) -> Any:
        """Send one command and return its result; events of the page meanwhile are stored.

        Raises:
            AssertionError: Firefox reports an error. TimeoutError: it does not
                answer.
        """
        self._last += 1
        command = {"id": self._last, "method": method, "params": parameters}
        self._connection.send(json.dumps(command))
        deadline = time.monotonic() + _ANSWER_S
        while True:
            told = json.loads(self._connection.recv(deadline - time.monotonic()))
            if told["type"] == "event":
                self._hear(told["method"], told["params"])
            elif told["id"] == self._last:
                assert told["type"] == "success", f"{method}: {told['error']}: {told['message']}"
                return told["result"]

    def _hear(self, event: str, told: Any) -> None:
        if event == "network.beforeRequestSent":
            self.requested.append(told["request"]["url"])
        elif event == "log.entryAdded" and told["level"] == "error":
            frames = (told.get("stackTrace") or {}).get("callFrames") or [{}]
            self.errors.append(f"{told['text']} {frames[0].get('url', '')}".strip())

    def open(self, address: str, width: int, height: int) -> None:
        """Load an address in a window of the given size, pixels."""
        size = {"width": width, "height": height}
        self.ask("browsingContext.setViewport", context=self._context, viewport=size)
        self.ask("browsingContext.navigate", context=self._context, url=address, wait="complete")

    def frame(self, part: str) -> str | None:
        """Return the context of the frame whose address contains ``part``, for ``evaluate``."""
        tree = self.ask("browsingContext.getTree", root=self._context)["contexts"][0]
        found = (str(each["context"]) for each in tree["children"] if part in each["url"])
        return next(found, None)

    def evaluate(self, function: str, *arguments: Any, context: str | None = None) -> Any:
        """Call a JavaScript function with JSON values, and return its JSON value.

        Args:
            context: of a frame; by default the page's.

        Raises:
            AssertionError: it throws.
        """
        result = self.ask(
            "script.callFunction",
            functionDeclaration=(
                f"async (given) => JSON.stringify(await ({function})(...JSON.parse(given)) ?? null)"
            ),
            arguments=[{"type": "string", "value": json.dumps(arguments)}],
            target={"context": context or self._context},
            awaitPromise=True,
        )
        assert result["type"] == "success", result["exceptionDetails"]["text"]
        return json.loads(result["result"]["value"])

    def wait_for(
        self,
        function: str,
        *arguments: Any,
        context: str | None = None,
        within_s: float = 30.0,
    ) -> Any:
        """Call a function until it returns something true; return that."""
        deadline = time.monotonic() + within_s
        while not (value := self.evaluate(function, *arguments, context=context)):
            assert time.monotonic() < deadline, f"not within {within_s} s: {function} {arguments}"
            time.sleep(0.1)
        return value

    def click(self, selector: str) -> None:
        """Click in the middle of the first element that a selector finds."""
        place = self.evaluate(
            """(selector) => {
              const element = document.querySelector(selector);
              element.scrollIntoView({ block: "nearest" });
              const { x, y, width, height } = element.getBoundingClientRect();
              return [Math.round(x + width / 2), Math.round(y + height / 2)];
            }""",
            selector,
        )
        moves = {"type": "pointerMove", "x": place[0], "y": place[1]}
        presses = [{"type": kind, "button": 0} for kind in ("pointerDown", "pointerUp")]
        self._perform(type="pointer", id="mouse", actions=[moves, *presses])

    def press(self, *keys: str) -> None:
        """Press and release keys one after another: characters, or WebDriver's codes."""
        strokes = [
            {"type": kind, "value": key} for key in keys for kind in ("keyDown", "keyUp")
        ]  # fmt: skip
        self._perform(type="key", id="keyboard", actions=strokes)

    def _perform(self, **source: Any) -> None:
        self.ask("input.performActions", context=self._context, actions=[source])

    def keep_picture(self, path: Path) -> None:
        """Write the visible part of the page as a PNG."""
        picture = self.ask("browsingContext.captureScreenshot", context=self._context)
        path.write_bytes(base64.b64decode(picture["data"]))


@contextmanager
def launched(path: str, profile: Path) -> Iterator[Tab]:
    """Launch a Firefox on a screen of its own; yield its only tab.

    Args:
        profile: an empty folder for everything it writes.
    """
    preferences = [f"user_pref({json.dumps(k)}, {json.dumps(v)});" for k, v in _PREFERENCES.items()]
    (profile / "user.js").write_text("\n".join(preferences))
    output = profile / "output.txt"
    options = ("--no-remote", "--remote-debugging-port=0", "--profile", str(profile))
    with _screen() as display, output.open("w") as stream:
        environment = {**os.environ, "DISPLAY": display, "LIBGL_ALWAYS_SOFTWARE": "1"}
        with (
            subprocess.Popen(
                [path, *options], stdout=stream, stderr=subprocess.STDOUT, env=environment
            ) as process,
            ended_after(process, _STOP_S),
        ):
            address = f"{_wait_for_address(process, output)}/session"
            with connect(address, max_size=None, compression=None, proxy=None) as connection:
                tab = Tab(connection)
                yield tab
                tab.ask("browser.close")
            process.wait(_STOP_S)


@contextmanager
def _screen() -> Iterator[str]:
    """Yield the name of a virtual display."""
    command = ["Xvfb", "-displayfd", "1", "-screen", "0", "1600x1200x24", "-nolisten", "tcp"]
    with (
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process,
        ended_after(process, _STOP_S),
    ):
        assert process.stdout is not None
        # It prints its number once it is ready, or nothing if it ended.
        number = process.stdout.readline().decode().strip()
        assert number, "Xvfb did not start"
        yield f":{number}"


def _wait_for_address(process: subprocess.Popen[bytes], output: Path) -> str:
    deadline = time.monotonic() + _START_S
    while time.monotonic() < deadline:
        found = re.search(r"BiDi listening on (ws://\S+)", output.read_text())
        if found:
            return found.group(1)
        assert process.poll() is None, f"Firefox ended: {output.read_text()}"
        time.sleep(0.1)
    raise AssertionError(f"Firefox does not listen within {_START_S:.0f} s: {output.read_text()}")
