"""What one rule, or all of them, leave of a wanted velocity."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Limit:
    """A share of the wanted velocity and why it is not the whole.

    Attributes:
        comes: what limits comes nearer by itself, as sonar hears; nothing was driven up to.
    """

    share: float
    reason: str | None = None
    comes: bool = False
