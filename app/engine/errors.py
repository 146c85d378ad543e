"""What the engine refuses, beside the library's own errors."""

from __future__ import annotations

from observer.errors import DynamicObserverError


class NotNow(DynamicObserverError):
    """What was asked is right in itself, but not possible in the engine's present state."""
