"""What asking another process can come to."""

from __future__ import annotations

from typing import Literal

from observer.errors import DynamicObserverError


class ProcessRefused(DynamicObserverError):
    """The process answered that it will not or could not.

    Attributes:
        refusal: ``input`` (what was asked is wrong), ``state`` (not possible now), ``full``
            (the disk is) or ``failure`` (it was tried and failed).
    """

    def __init__(self, message: str, refusal: Literal["input", "state", "full", "failure"]) -> None:
        self.refusal = refusal
        super().__init__(message)


class ProcessUnavailable(DynamicObserverError):
    """There is no process that could answer at this moment."""
