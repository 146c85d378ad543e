"""Admission: scripts by the token itself, browsers by the session that they got for it; each as
an operator or as a read-only client (``app.http.gate.access``).

The only place that reads the cookie, for requests, WebSockets and the viewer alike.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from starlette.types import Scope

from app.http.gate.access import Access
from app.http.gate.connections import Connections
from app.http.gate.read_only_links import ReadOnlyLink
from app.http.gate.session_file import SessionFile
from app.http.gate.sessions import Session, Sessions
from app.http.gate.strangers import SIGNED_IN
from app.http.gate.token import TokenGuard, TokenVerdict

COOKIE_NAME = "dynamic_observer_session"

# Keys of a request's state: its session (None if it came with a token), and the read-only link
# behind either (None for an operator).
_SESSION = "session"
_LINK = "link"
# More than a browser sends in one cookie; one request must not try a list of tokens.
_MOST_CANDIDATES = 4

# Addresses of the 3D scene's page, its socket and its scripts, for one session each.
_VIEWED = re.compile(r"/viewer/(?P<key>[A-Za-z0-9_-]{43})(?:/|$)")

_SIGN_IN_FIRST = (
    "sign in first: open the link that the server printed at start-up, or send the header "
    "Authorization: Bearer TOKEN; --token-file keeps the token across restarts"
)
_SESSION_ENDED = (
    "this session has ended; sign in again with the link that the server printed at start-up"
)
_WRONG_TOKEN = (  # nosec B105
    "wrong token; open the link that the server printed at start-up"
)
_TOO_MANY = "too many wrong tokens from this address; wait a minute (the right token still works)"


@dataclass(frozen=True)
class Refusal:
    """Reply sent in place of the application's.

    Attributes:
        on_page: whether the sign-in page shows the detail too; it asks for the token in any case.
    """

    status: int
    detail: str
    headers: tuple[tuple[bytes, bytes], ...] = ()
    on_page: bool = True


@dataclass(frozen=True)
class Admission:
    """Check of tokens and sessions, signing in and signing out.

    Attributes:
        guard: checks the token. sessions: those of browsers. file: keeps them.
        tls: whether the cookie is for encrypted connections only.
    """

    guard: TokenGuard
    sessions: Sessions
    file: SessionFile
    tls: bool

    def admit(self, scope: Scope) -> Refusal | None:
        """Return why a request may not come in, or None if it may.

        ``session_of``, ``link_of`` and ``access_of`` then tell what admitted it, and its access.
        """
        viewed = self.viewed(scope)
        if viewed is not None:
            _note_viewer(scope, viewed)
            return None
        ids = _session_ids(scope)
        _, session = self._found(ids)
        if session is not None:
            _note(scope, session, session.link)
            return None
        return self._check_token(scope, _bearer_tokens(scope), ended=bool(ids))

    def viewed(self, scope: Scope) -> Session | None:
        """Return the session whose key for the 3D scene is part of the requested address."""
        match = _VIEWED.match(scope["path"])
        return None if match is None else self.sessions.find_by_viewer_key(match["key"])

    def is_signed_in(self, scope: Scope) -> bool:
        """Return whether the request comes from a browser with a session."""
        return self._found(_session_ids(scope))[1] is not None

    async def sign_in(self, scope: Scope, tokens: list[str]) -> str | Refusal:
        """Exchange a token for a session, and return its ``Set-Cookie``.

        A browser that has a session keeps it: somebody may be driving in another of its tabs. Only
        a read-only session is replaced, by an operator's or by one of another read-only link.
        """
        refusal = self._check_token(scope, tokens)
        if refusal is not None:
            return refusal
        link = link_of(scope)
        session_id, session = self._found(_session_ids(scope))
        if session is not None and session.link is not None and session.link is not link:
            self.sessions.end(session)
            session = None
        if session is None:
            session_id = self.sessions.start(link)
        elif session.link is link:
            self.sessions.renew(session)
        await self.file.save()
        return self._cookie(session_id, int(self.sessions.lifetime_s))

    async def sign_out(self, session: Session) -> str:
        """End a session and return the ``Set-Cookie`` that deletes its cookie."""
        self.sessions.end(session)
        await self.file.save()
        return self._cookie("", 0)

    async def make_link(self) -> ReadOnlyLink:
        """Make another read-only link; raises as ``ReadOnlyLinks.make``."""
        link = self.sessions.links.make()
        await self.file.save()
        return link

    async def revoke(self, link: ReadOnlyLink) -> None:
        """End a read-only link, with all sessions and WebSockets opened with it."""
        self.sessions.revoke(link)
        await self.file.save()

    async def sign_out_everywhere(self) -> str:
        """End every session and return the ``Set-Cookie`` that deletes the cookie."""
        self.sessions.end_all()
        await self.file.save()
        return self._cookie("", 0)

    def _found(self, ids: list[str]) -> tuple[str, Session | None]:
        """Return the first of the ids that has a session, with it."""
        found = ((each, self.sessions.find(each)) for each in ids)
        return next((each for each in found if each[1] is not None), ("", None))

    def _check_token(
        self, scope: Scope, tokens: list[str], *, ended: bool = False
    ) -> Refusal | None:
        client = scope.get("client")
        verdict = self.guard.check(client[0] if client else None, tokens[:_MOST_CANDIDATES])
        if isinstance(verdict, ReadOnlyLink):
            _note(scope, None, verdict)
            return None
        if verdict is TokenVerdict.OPERATOR:
            _note(scope, None, None)
            return None
        if verdict is TokenVerdict.LIMITED:
            return Refusal(429, _TOO_MANY, ((b"retry-after", b"60"),))
        # A session id is no guess at the token: the session may have ended or be another server's.
        missing = _SESSION_ENDED if ended else _SIGN_IN_FIRST
        text = missing if verdict is TokenVerdict.MISSING else _WRONG_TOKEN
        on_page = text is not _SIGN_IN_FIRST
        return Refusal(401, text, ((b"www-authenticate", b"Bearer"),), on_page)

    def _cookie(self, value: str, seconds: int) -> str:
        secure = "; Secure" if self.tls else ""
        return (
            f"{COOKIE_NAME}={value}; Path=/; Max-Age={seconds}; HttpOnly; SameSite=Strict{secure}"
        )


def session_of(scope: Scope) -> Session | None:
    """Return the session by which a request was admitted; None if it came with the token."""
    session: Session | None = scope.get("state", {}).get(_SESSION)
    return session


def link_of(scope: Scope) -> ReadOnlyLink | None:
    """Return the read-only link by which a request was admitted; None for an operator."""
    link: ReadOnlyLink | None = scope.get("state", {}).get(_LINK)
    return link


def connections_of(scope: Scope) -> Connections | None:
    """Return the session or link that a connection ends with; None for the operators' token."""
    return session_of(scope) or link_of(scope)


def access_of(scope: Scope) -> Access:
    """Return what an admitted request may do.

    A request that was not admitted may only watch.
    """
    is_operator = _LINK in scope.get("state", {}) and link_of(scope) is None
    return Access.OPERATOR if is_operator else Access.READ_ONLY


def header_values(scope: Scope, name: bytes) -> list[str]:
    """Return the values of a header, by its name in lower case."""
    return [value.decode("latin-1") for key, value in scope["headers"] if key.lower() == name]


def _note_viewer(scope: Scope, session: Session) -> None:
    """Note an admission by the 3D scene's key: it ends with the session, and only watches."""
    scope.setdefault("state", {}).update({SIGNED_IN: True, _SESSION: session})


def _note(scope: Scope, session: Session | None, link: ReadOnlyLink | None) -> None:
    state = {SIGNED_IN: True, _SESSION: session, _LINK: link}
    scope.setdefault("state", {}).update(state)


def _bearer_tokens(scope: Scope) -> list[str]:
    pairs = [value.partition(" ") for value in header_values(scope, b"authorization")]
    return [token.strip() for kind, _, token in pairs if kind.lower() == "bearer" and token.strip()]


def _session_ids(scope: Scope) -> list[str]:
    return list(_cookies(scope))[:_MOST_CANDIDATES]


def _cookies(scope: Scope) -> Iterator[str]:
    for value in header_values(scope, b"cookie"):
        for part in value.split(";"):
            name, _, session_id = part.strip().partition("=")
            if name == COOKIE_NAME and session_id:
                yield session_id
