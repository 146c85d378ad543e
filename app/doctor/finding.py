"""What the doctor finds: one line each, with how bad it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

# ``warning``: something will not work, or not well. ``problem``: it hinders the start.
Level = Literal["ok", "warning", "problem"]


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Attributes:
        section: heading under which it stands, as in ``Cameras``.
        level: how bad it is.
        text: one sentence; where something is wrong, it says what to do.
        details: further lines that belong to it.
    """

    section: str
    level: Level
    text: str
    details: tuple[str, ...] = ()
