"""Sessions of the browsers that have signed in.

A browser exchanges the token for a random id of 256 bits and keeps that in its cookie. The server
keeps HMAC-SHA256(token, id) only: what it stores signs nobody in, and with another token every
session ends by itself.

Signed cookies without a table would be no simpler: to sign one browser out at once, the server must
know which ids are revoked and which connections are theirs. The table of sessions tells both.
"""

from __future__ import annotations

import base64
import hashlib
import hmac
import secrets
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from app.http.gate.connections import Connections
from app.http.gate.read_only_links import ReadOnlyLink, ReadOnlyLinks

_ID_BYTES = 32
# Keeps keys for the 3D scene apart from digests of ids.
_VIEWER = b"viewer "
# Bounds the memory that repeated signing in can take.
_MOST = 200


@dataclass(eq=False)
class Session(Connections):
    """Session of one browser.

    Attributes:
        digest: of its id. started, used: monotonic seconds of signing in and of the last use.
        link: the read-only link that it was opened with; None for an operator's.
        viewer_key: admits the page of its 3D scene, to that scene only. It is part of the page's
            address, because the page has an origin of its own and sends no cookie.
    """

    digest: bytes
    started: float
    used: float
    link: ReadOnlyLink | None
    viewer_key: str


@dataclass(frozen=True)
class SessionAge:
    """Session as it outlives the process: its digest, and seconds since its start and last use.

    Attributes:
        link: id of the read-only link that it was opened with; None for an operator's.
    """

    digest: bytes
    age_s: float
    unused_s: float
    link: str | None = None


class Sessions:
    """Table of sessions; used in the event loop.

    Args:
        token: what the sessions were exchanged for.
        clock: monotonic seconds. The wall clock may jump while somebody drives.
        unused_s: a session ends after this long without a request or an open connection.
        lifetime_s: it ends this long after signing in, even while in use.
        most: beyond this number, the least recently used sessions without open connections end.

    Attributes:
        links: the valid read-only links.
    """

    def __init__(
        self,
        token: str,
        clock: Callable[[], float],
        *,
        unused_s: float,
        lifetime_s: float,
        most: int = _MOST,
    ) -> None:
        self._key = token.encode("utf-8", "surrogatepass")
        self._clock = clock
        self._unused_s, self._lifetime_s, self._most = unused_s, lifetime_s, most
        self._sessions: dict[bytes, Session] = {}
        self.links = ReadOnlyLinks(token)

    @property
    def lifetime_s(self) -> float:
        """Return the longest life of a session in seconds."""
        return self._lifetime_s

    def start(self, link: ReadOnlyLink | None = None) -> str:
        """Start a session (an operator's if no link is given) and return its id."""
        session_id, now = secrets.token_urlsafe(_ID_BYTES), self._clock()
        session = self._session(self._digest(session_id), now, now, link)
        self._sessions[session.digest] = session
        self._make_room(session)
        return session_id

    def find(self, session_id: str) -> Session | None:
        """Return the session of this id and note its use; None if there is none, or it has ended.

        The time that it takes reveals nothing: without the token nobody can choose a digest.
        """
        session = self._sessions.get(self._digest(session_id))
        return session if session is not None and self._note_use(session) else None

    def find_by_viewer_key(self, key: str) -> Session | None:
        """Return the session with this key of the 3D scene and note its use, or None."""
        wanted = key.encode("utf-8", "surrogatepass")
        for session in self._sessions.values():
            if hmac.compare_digest(session.viewer_key.encode(), wanted):
                return session if self._note_use(session) else None
        return None

    def renew(self, session: Session) -> None:
        """Restart a session's lifetime: its browser has sent the token again."""
        session.started = session.used = self._clock()

    def end(self, session: Session) -> None:
        """End a session and close its connections."""
        self._sessions.pop(session.digest, None)
        session.end()

    def end_all(self) -> None:
        """End every session."""
        for session in tuple(self._sessions.values()):
            self.end(session)

    def revoke(self, link: ReadOnlyLink) -> None:
        """End a read-only link, the sessions opened with it, and their connections."""
        self.links.revoke(link)
        for session in self._by(link):
            self.end(session)

    def watching(self, link: ReadOnlyLink) -> int:
        """Return how many browsers are connected by a read-only link; scripts count as one."""
        return sum(bool(each.closers) for each in self._by(link)) + bool(link.closers)

    def _by(self, link: ReadOnlyLink) -> list[Session]:
        return [each for each in self._sessions.values() if each.link is link]

    def sweep(self) -> None:
        """End the sessions that are too old, and note that those with open connections are used."""
        now = self._clock()
        for session in tuple(self._sessions.values()):
            if session.closers:
                session.used = now
            if self._is_old(session, now):
                self.end(session)

    def ages(self) -> list[SessionAge]:
        """Return what a later process needs in order to go on with the sessions."""
        now = self._clock()
        return [
            SessionAge(
                each.digest,
                now - each.started,
                now - each.used,
                None if each.link is None else each.link.id,
            )
            for each in self._sessions.values()
        ]

    def restore(self, ages: Iterable[SessionAge]) -> None:
        """Add the sessions of an earlier process, except those that have ended meanwhile.

        Their links must have been restored before.
        """
        now = self._clock()
        for each in ages:
            link = self.links.get(each.link)
            if link is None and each.link is not None:
                continue
            # The ages come from the wall clock, which may have been set back.
            session = self._session(
                each.digest,
                now - max(0.0, each.age_s),
                now - max(0.0, each.unused_s),
                link,
            )
            if not self._is_old(session, now):
                self._sessions[session.digest] = session
                self._make_room(session)

    def _session(
        self, digest: bytes, started: float, used: float, link: ReadOnlyLink | None
    ) -> Session:
        key = hmac.digest(self._key, _VIEWER + digest, hashlib.sha256)
        text = base64.urlsafe_b64encode(key).rstrip(b"=").decode()
        return Session(digest, started, used, link, text)

    def _digest(self, session_id: str) -> bytes:
        return hmac.digest(self._key, session_id.encode("utf-8", "surrogatepass"), hashlib.sha256)

    def _note_use(self, session: Session) -> bool:
        """Note that a session is used; end it and return False if it is too old."""
        now = self._clock()
        if self._is_old(session, now):
            self.end(session)
            return False
        session.used = now
        return True

    def _is_old(self, session: Session, now: float) -> bool:
        unused_s = 0.0 if session.closers else now - session.used
        return now - session.started > self._lifetime_s or unused_s > self._unused_s

    def _make_room(self, new: Session) -> None:
        """End the least recently used idle session if there are too many."""
        if len(self._sessions) <= self._most:
            return
        idle = [each for each in self._sessions.values() if not each.closers and each is not new]
        if idle:
            self.end(min(idle, key=lambda each: each.used))
