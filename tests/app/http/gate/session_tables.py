"""Tables of sessions with short limits."""

from __future__ import annotations

from typing import Any

from app.http.gate.sessions import Sessions

from ..clock import Clock

TOKEN = "t" * 43
UNUSED_S, LIFETIME_S = 100.0, 1000.0


def table(clock: Clock, token: str = TOKEN, most: int = 200) -> Sessions:
    return Sessions(token, clock, unused_s=UNUSED_S, lifetime_s=LIFETIME_S, most=most)


def found(sessions: Sessions, session_id: str) -> Any:
    session = sessions.find(session_id)
    assert session is not None
    return session
