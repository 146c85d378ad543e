"""Refusals of commands, in addition to the library's own errors."""

from __future__ import annotations

from app.runtime.requests import Refusal, Reply
from observer.errors import DynamicObserverError, InputError
from observer.recording.errors import RecordingError


class NotNow(DynamicObserverError):
    """Command that is valid in itself but not possible in the engine's present state."""


def refusal(number: int, error: DynamicObserverError) -> Reply:
    """Return the refusal of a request: invalid, not possible now, or failed for a known reason."""
    kind: Refusal = "failure"
    if isinstance(error, NotNow):
        kind = "state"
    elif isinstance(error, RecordingError) and error.full:
        kind = "full"
    elif isinstance(error, InputError):
        kind = "input"
    return Reply(number, error=str(error), refusal=kind)


def unexpected(error: BaseException | None) -> str:
    """Describe an unforeseen error in words."""
    return f"internal error ({type(error).__name__}: {error}); see the server's log"
