"""Why driving by a server ended."""

from __future__ import annotations

from observer.errors import DynamicObserverError


class DrivingFailed(DynamicObserverError):
    """The server or a robot would not, or the link to them was lost."""
