"""Followers of the server."""

from __future__ import annotations

import contextlib
from collections.abc import Callable

from app.contract.events import ObservationEvent
from app.server.contracts import Listener


class Followers:
    """Distributor of events to all followers, in the event loop."""

    def __init__(self) -> None:
        self._listeners: list[Listener] = []

    def follow(self, listener: Listener) -> Callable[[], None]:
        """Notify ``listener`` of everything from now on; return a function that ends this."""
        self._listeners.append(listener)

        def unfollow() -> None:
            with contextlib.suppress(ValueError):
                self._listeners.remove(listener)

        return unfollow

    def status_changed(self) -> None:
        """Notify all followers that the status changed."""
        for listener in tuple(self._listeners):
            listener.status_changed()

    def observed(self, event: ObservationEvent) -> None:
        """Notify all followers of a frame."""
        for listener in tuple(self._listeners):
            listener.observed(event)

    def robots_changed(self) -> None:
        """Notify all followers that the robots' facts changed."""
        for listener in tuple(self._listeners):
            listener.robots_changed()
