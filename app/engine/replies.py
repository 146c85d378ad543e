"""Refusals of commands."""

from __future__ import annotations

from app.engine.errors import NotNow
from app.runtime.requests import Reply
from observer.errors import DynamicObserverError, InputError
from observer.recording.errors import RecordingError


def refusal(number: int, error: DynamicObserverError) -> Reply:
    """Return the refusal of a request: invalid, not possible now, or failed for a known reason."""
    if isinstance(error, NotNow):
        return Reply(number, error=str(error), refusal="state")
    if isinstance(error, RecordingError) and error.full:
        return Reply(number, error=str(error), refusal="full")
    if isinstance(error, InputError):
        return Reply(number, error=str(error), refusal="input")
    return Reply(number, error=str(error), refusal="failure")


def unexpected(error: BaseException | None) -> str:
    """Describe an unforeseen error in words."""
    return f"{type(error).__name__}: {error}"
