"""Opening the page in the browser of the desktop at which the server is started.

Only for a person who sits at it: the server was started on a terminal, with a display, and not
over SSH, where the browser would open on the remote computer. Failing to open it does no harm: the
link is printed in any case.
"""

from __future__ import annotations

import os
import sys
import threading
import webbrowser
from collections.abc import Mapping

_REMOTE = ("SSH_CONNECTION", "SSH_CLIENT", "SSH_TTY")
_DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")


def has_desktop(environment: Mapping[str, str], platform: str, *, terminal: bool) -> bool:
    """Return whether a person at this computer's own desktop starts the server.

    Args:
        environment: variables of the process. platform: as ``sys.platform`` names it.
        terminal: whether the output goes to a terminal; scripts and services have none.
    """
    if not terminal or any(environment.get(name) for name in (*_REMOTE, "CI")):
        return False
    return platform in ("darwin", "win32") or any(environment.get(name) for name in _DISPLAYS)


def at_desktop() -> bool:
    """Return whether this process was started at a desktop."""
    return has_desktop(os.environ, sys.platform, terminal=sys.stdout.isatty())


def open_page(link: str) -> None:
    """Open a link in the desktop's browser, without waiting for it."""
    # A browser may keep its caller until it is closed.
    threading.Thread(target=_open, args=(link,), name="browser", daemon=True).start()


def _open(link: str) -> None:
    try:
        browser = webbrowser.get()
    except webbrowser.Error:
        return
    # Text browsers would take over the server's terminal.
    if type(browser) is not webbrowser.GenericBrowser:
        browser.open(link)
