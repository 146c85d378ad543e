"""Read-only links: tokens for watching only, each of which can be revoked by itself."""

from __future__ import annotations

import base64
import hashlib
import hmac
import secrets
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from app.http.gate.connections import Connections

_ID_BYTES = 8
# Enough for one per class or visitor; bounds the cost of each check of a token.
MOST_LINKS = 20


@dataclass(eq=False)
class ReadOnlyLink(Connections):
    """Valid read-only link.

    Attributes:
        id: not secret. token: signs a browser in. made: seconds since 1970.
    """

    id: str
    token: str
    made: float


class ReadOnlyLinks:
    """Table of the valid read-only links; there is always one to share. Used in the event loop.

    Tokens are derived from the operators' token, which they do not reveal, and from the link's id:
    they last as long as that token, and a file of ids signs nobody in.

    Args:
        token: the operators'. wall_clock: seconds since 1970.

    Attributes:
        changed: called after a link was made or revoked.
    """

    def __init__(self, token: str, wall_clock: Callable[[], float] = time.time) -> None:
        self._key = token.encode("utf-8", "surrogatepass")
        self._wall_clock = wall_clock
        self.changed: Callable[[], None] = lambda: None
        self._links: dict[str, ReadOnlyLink] = {}
        self._ensure_one()

    @property
    def in_force(self) -> list[ReadOnlyLink]:
        """Return all links, oldest first."""
        return list(self._links.values())

    @property
    def newest(self) -> ReadOnlyLink:
        """Return the link to share."""
        return self.in_force[-1]

    def get(self, link_id: str | None) -> ReadOnlyLink | None:
        """Return the link of this id; None if it is not valid."""
        return None if link_id is None else self._links.get(link_id)

    def find(self, candidates: Iterable[str]) -> ReadOnlyLink | None:
        """Return the link that one of the tokens belongs to.

        Every pair is compared, so that the time does not reveal which one was right.
        """
        given = [digest(each) for each in candidates]
        found = [
            link
            for link in self._links.values()
            if sum([hmac.compare_digest(digest(link.token), each) for each in given])
        ]
        return found[0] if found else None

    def make(self) -> ReadOnlyLink:
        """Make another link, which from now on is the one to share.

        Raises:
            ValueError: there are ``MOST_LINKS`` already.
        """
        if len(self._links) >= MOST_LINKS:
            raise ValueError(
                f"{MOST_LINKS} read-only links already exist; revoke one of them first"
            )
        link = self._link(secrets.token_hex(_ID_BYTES), self._wall_clock())
        self._links[link.id] = link
        self.changed()
        return link

    def revoke(self, link: ReadOnlyLink) -> None:
        """End a link and close the connections made directly with its token."""
        if self._links.pop(link.id, None) is None:
            return
        link.end()
        self._ensure_one()
        self.changed()

    def restore(self, kept: Iterable[tuple[str, float]]) -> None:
        """Restore the links of an earlier process from what its ``kept`` returned."""
        links = [self._link(id, made) for id, made in kept]
        if links:
            self._links = {link.id: link for link in links[-MOST_LINKS:]}
            self.changed()

    def kept(self) -> list[tuple[str, float]]:
        """Return id and creation time of each link, oldest first."""
        return [(link.id, link.made) for link in self._links.values()]

    def _ensure_one(self) -> None:
        if not self._links:
            self.make()

    def _link(self, id: str, made: float) -> ReadOnlyLink:
        made_of = hmac.digest(self._key, f"read-only {id}".encode(), hashlib.sha256)
        token = base64.urlsafe_b64encode(made_of).rstrip(b"=").decode()
        return ReadOnlyLink(id=id, token=token, made=made)


def digest(token: str) -> bytes:
    """Return a digest to compare; its length does not reveal the token's."""
    return hashlib.sha256(token.encode("utf-8", "surrogatepass")).digest()
