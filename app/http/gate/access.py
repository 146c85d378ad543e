"""Access that a sign-in gives: an operator may change things, a read-only link only watches.

The gate (``app.http.gate.security``) refuses every request of a read-only link that could change
something, new routes included; the few exceptions are listed here. The drive socket checks access
itself.
"""

from __future__ import annotations

import re
from enum import StrEnum

# Methods that change nothing.
SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
WATCHING_ONLY = "This link is read-only. Ask for an operator link to change anything."

# Method and path of requests that read-only clients may make too; * is one segment of a path.
FOR_EVERYONE = (
    # Anyone who sees something go wrong may stop the robots.
    ("POST", "/api/robots/stop"),
    # One's own session.
    ("DELETE", "/api/session"),
)
_FOR_EVERYONE = tuple(
    (method, re.compile(re.escape(path).replace(r"\*", "[^/]+"))) for method, path in FOR_EVERYONE
)


class Access(StrEnum):
    """Access that a sign-in gives."""

    OPERATOR = "operator"
    READ_ONLY = "read_only"

    def allows(self, method: str, path: str) -> bool:
        """Return whether a request may pass."""
        if self is Access.OPERATOR or method in SAFE_METHODS:
            return True
        return any(method == each and regex.fullmatch(path) for each, regex in _FOR_EVERYONE)
