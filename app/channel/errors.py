"""What can go wrong between the processes."""

from __future__ import annotations

from observer.errors import DynamicObserverError


class ChannelError(DynamicObserverError):
    """A value or message cannot be passed between the processes."""
