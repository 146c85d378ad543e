"""Findings of the doctor: one line each, with its severity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

# ``warning``: a feature will not work, or not well. ``problem``: it prevents the start.
Level = Literal["ok", "warning", "problem"]


@dataclass(frozen=True)
class Finding:
    """Result of one check.

    Attributes:
        section: heading of the finding, such as ``Cameras``.
        level: severity.
        text: one sentence; if something is wrong, it says what to do.
        details: further lines of the finding.
    """

    section: str
    level: Level
    text: str
    details: tuple[str, ...] = ()


@dataclass(frozen=True)
class Section:
    """Heading of findings; each method makes one of its level."""

    name: str

    def ok(self, text: str, details: tuple[str, ...] = ()) -> Finding:
        return Finding(self.name, "ok", text, details)

    def warning(self, text: str, details: tuple[str, ...] = ()) -> Finding:
        return Finding(self.name, "warning", text, details)

    def problem(self, text: str, details: tuple[str, ...] = ()) -> Finding:
        return Finding(self.name, "problem", text, details)
