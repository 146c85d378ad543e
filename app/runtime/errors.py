"""Failures in sending something to another process, or in querying it."""

from __future__ import annotations

from app.runtime.requests import Refusal
from observer.errors import DynamicObserverError


class ChannelError(DynamicObserverError):
    """Failure to pass a value or message between processes."""


class ProcessRefused(DynamicObserverError):
    """Refusal by a process that would not or could not carry out a request.

    Attributes:
        refusal: see ``app.runtime.requests.Refusal``.
    """

    def __init__(self, message: str, refusal: Refusal) -> None:
        self.refusal = refusal
        super().__init__(message)


class ProcessUnavailable(DynamicObserverError):
    """No process can answer at this moment."""
