"""Links to share, and what the one who asks may do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from app.contract.values import means

AccessWord = Literal["operator", "read_only"]


@dataclass(frozen=True)
class SessionNow:
    """The session, or the token, of the one who asks."""

    access: Annotated[AccessWord, means("An operator changes things; a read-only link watches.")]


@dataclass(frozen=True)
class ShareLink:
    address: Annotated[str, means("Without the token, to be shown.")]
    link: Annotated[str, means("Signs a browser in: treat it as a password.")]
    here: Annotated[bool, means("Whether only the server's own computer can open it.")]


@dataclass(frozen=True)
class ReadOnlyLinkNow:
    """A read-only link in force."""

    id: str
    made_at: str
    watching: Annotated[int, means("Number of browsers that have a page open by it.")]
    shared: Annotated[bool, means("Whether it is the one that is shared, the newest.")]


@dataclass(frozen=True)
class ShareLinks:
    access: AccessWord
    links: Annotated[Sequence[ShareLink], means("The likeliest first.")]
    note: Annotated[str | None, means("Why other computers cannot open them, and what to do.")]
