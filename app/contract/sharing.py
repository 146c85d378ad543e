"""Links to share, and the access rights of the request."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from app.contract.values import means

AccessWord = Literal["operator", "read_only"]


@dataclass(frozen=True)
class SessionNow:
    """The session, or the token, of the request."""

    access: Annotated[AccessWord, means("An operator changes things; a read-only link watches.")]


@dataclass(frozen=True)
class ShareLink:
    address: Annotated[str, means("Address without the token, for display.")]
    link: Annotated[str, means("Signs a browser in: treat it as a password.")]
    here: Annotated[bool, means("Whether only the server's own computer can open it.")]


@dataclass(frozen=True)
class ReadOnlyLinkNow:
    """A valid read-only link."""

    id: str
    made_at: str
    watching: Annotated[int, means("Number of browsers that have a page open with it.")]
    shared: Annotated[bool, means("Whether it is the one that is shared: the newest.")]


@dataclass(frozen=True)
class ShareLinks:
    access: AccessWord
    links: Annotated[Sequence[ShareLink], means("The most likely address first.")]
    note: Annotated[str | None, means("Why other computers cannot open them, and what to do.")]
