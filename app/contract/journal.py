"""Log of what has happened that a person should know, as reported to clients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from app.contract.values import means

# Number of entries kept.
LOG_LENGTH = 500

Severity = Literal["info", "warning", "error"]


@dataclass(frozen=True)
class LogEntry:
    number: Annotated[int, means("Rises from 1 since the server started.")]
    time: Annotated[float, means("Wall clock, seconds since 1970.")]
    severity: Severity
    text: str


@dataclass(frozen=True)
class LogPage:
    entries: Annotated[Sequence[LogEntry], means("The last few hundred at most, oldest first.")]
