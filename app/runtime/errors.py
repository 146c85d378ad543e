"""Failures of passing something to another process, or of asking it."""

from __future__ import annotations

from app.runtime.requests import Refusal
from observer.errors import DynamicObserverError


class ChannelError(DynamicObserverError):
    """A value or message cannot be passed between the processes."""


class ProcessRefused(DynamicObserverError):
    """The process answered that it will not or could not.

    Attributes:
        refusal: see ``app.runtime.requests.Refusal``.
    """

    def __init__(self, message: str, refusal: Refusal) -> None:
        self.refusal = refusal
        super().__init__(message)


class ProcessUnavailable(DynamicObserverError):
    """There is no process that could answer at this moment."""
