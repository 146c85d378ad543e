"""Texts that name a robot's port, and how they are shown."""

from __future__ import annotations

import re

EXTERNAL, COPPELIASIM, SOCKET = "external:", "coppeliasim:", "socket://"
# Start of a key, even a mistyped one.
_BEFORE_KEY = re.compile(r"[?&]|key=", re.IGNORECASE)


def shown_port(port: str) -> str:
    """Return the text that names a robot's port without its key, for people, records and logs."""
    # Names of devices and of a scene's objects may hold anything.
    if port.startswith(COPPELIASIM) or re.match(r"\.{0,2}/", port):
        return port
    return _BEFORE_KEY.split(port, maxsplit=1)[0]
