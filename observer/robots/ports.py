"""Port names of robots, and how they are shown."""

from __future__ import annotations

import re

EXTERNAL, COPPELIASIM, SOCKET = "external:", "coppeliasim:", "socket://"
# Start of a key, even a mistyped one.
_BEFORE_KEY = re.compile(r"[?&]|key=", re.IGNORECASE)


def shown_port(port: str) -> str:
    """Return a robot's port name without its key, for display, records and logs."""
    # Names of devices and of a scene's objects may contain any character.
    if port.startswith(COPPELIASIM) or re.match(r"\.{0,2}/", port):
        return port
    return _BEFORE_KEY.split(port, maxsplit=1)[0]
