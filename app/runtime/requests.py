"""Envelopes of what is asked of another process and of its answer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

# ``input``: what was asked is wrong; ``state``: not possible now; ``full``: the disk is;
# ``failure``: it was tried and failed.
Refusal = Literal["input", "state", "full", "failure"]


@dataclass(frozen=True)
class Request:
    """One command to another process; ``command`` is one of those that it knows."""

    number: int
    command: Any


@dataclass(frozen=True)
class Reply:
    """Answer to one request: a value, or one sentence of why not and the kind of refusal."""

    number: int
    value: Any = None
    error: str | None = None
    refusal: Refusal | None = None
