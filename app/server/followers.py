"""Followers of the server."""

from __future__ import annotations

import contextlib
from collections.abc import Callable

import structlog

from app.contract.events import ObservationEvent
from app.server.contracts import Listener

log = structlog.get_logger(__name__)


class Followers:
    """Distributor of events to all followers, in the event loop; a failing one is logged."""

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
        self._each(lambda listener: listener.status_changed())

    def observed(self, event: ObservationEvent) -> None:
        """Notify all followers of a frame."""
        self._each(lambda listener: listener.observed(event))

    def robots_changed(self) -> None:
        """Notify all followers that the robots' facts changed."""
        self._each(lambda listener: listener.robots_changed())

    def _each(self, notify: Callable[[Listener], None]) -> None:
        for listener in tuple(self._listeners):
            try:
                notify(listener)
            except Exception:
                # A failing follower must affect neither the others nor the change itself.
                log.exception("follower_failed", follower=type(listener).__name__)
