"""Envelopes of requests to another process and of its replies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

# ``input``: the request is invalid; ``state``: not possible now; ``full``: the disk is full;
# ``failure``: it was tried and failed.
Refusal = Literal["input", "state", "full", "failure"]


@dataclass(frozen=True)
class Request:
    """Request to another process; ``command`` is one of those it knows."""

    number: int
    command: Any


@dataclass(frozen=True)
class Reply:
    """Reply to one request: a value, or one sentence on why not and the kind of refusal."""

    number: int
    value: Any = None
    error: str | None = None
    refusal: Refusal | None = None
