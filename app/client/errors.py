"""Reasons for the end of a drive through a server."""

from __future__ import annotations

from observer.errors import DynamicObserverError


class DrivingFailed(DynamicObserverError):
    """Refusal by the server or a robot, or a lost link to them."""
