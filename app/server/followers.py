"""Who follows the server."""

from __future__ import annotations

import contextlib
from collections.abc import Callable

from app.contract.events import ObservationEvent
from app.server.contracts import Listener


class Followers:
    """Hands what happens to everybody who asked for it, in the event loop."""

    def __init__(self) -> None:
        self._listeners: list[Listener] = []

    def follow(self, listener: Listener) -> Callable[[], None]:
        """Tell ``listener`` of everything from now on; returns how to end that."""
        self._listeners.append(listener)

        def unfollow() -> None:
            with contextlib.suppress(ValueError):
                self._listeners.remove(listener)

        return unfollow

    def status_changed(self) -> None:
        """Tell all that the status is another."""
        for listener in tuple(self._listeners):
            listener.status_changed()

    def observed(self, event: ObservationEvent) -> None:
        """Tell all of a frame."""
        for listener in tuple(self._listeners):
            listener.observed(event)

    def robots_changed(self) -> None:
        """Tell all that the robots are otherwise."""
        for listener in tuple(self._listeners):
            listener.robots_changed()
