"""Errors with which the engine refuses a command, beside the library's own."""

from __future__ import annotations

from observer.errors import DynamicObserverError


class NotNow(DynamicObserverError):
    """Command that is valid in itself but not possible in the engine's present state."""
