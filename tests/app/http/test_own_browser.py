"""The page opens by itself only for a person at the server's own desktop."""

from __future__ import annotations

import webbrowser
from typing import Any

import pytest

from app.http import own_browser
from app.http.own_browser import has_desktop

DESKTOP = {"DISPLAY": ":0", "HOME": "/home/ada"}


@pytest.mark.parametrize(
    ("environment", "platform", "terminal", "expected"),
    [
        (DESKTOP, "linux", True, True),
        ({"WAYLAND_DISPLAY": "wayland-0"}, "linux", True, True),
        ({}, "darwin", True, True),
        ({}, "linux", True, False),
        ({"DISPLAY": ""}, "linux", True, False),
        (DESKTOP, "linux", False, False),
        ({**DESKTOP, "SSH_CONNECTION": "10.0.0.1 5 10.0.0.2 22"}, "linux", True, False),
        ({"SSH_TTY": "/dev/pts/3"}, "darwin", True, False),
        ({**DESKTOP, "CI": "true"}, "linux", True, False),
    ],
)
def test_a_browser_opens_only_on_a_desktop(
    environment: dict[str, str], platform: str, terminal: bool, expected: bool
) -> None:
    assert has_desktop(environment, platform, terminal=terminal) is expected


def test_no_text_mode_browser_is_started(monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []

    class Drawing(webbrowser.GenericBrowser):
        def open(self, url: str, *_: Any) -> bool:
            opened.append(url)
            return True

    monkeypatch.setattr(webbrowser, "get", lambda: Drawing("firefox"))
    own_browser._open("http://localhost/?token=once")
    assert opened == ["http://localhost/?token=once"]
    monkeypatch.setattr(webbrowser, "get", lambda: webbrowser.GenericBrowser("/bin/false"))
    own_browser._open("http://localhost/")

    def none() -> None:
        raise webbrowser.Error("could not locate runnable browser")

    monkeypatch.setattr(webbrowser, "get", none)
    own_browser._open("http://localhost/")
    assert len(opened) == 1
