"""Listeners to the events of a process."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable
from typing import Generic, TypeVar

_log = logging.getLogger(__name__)

_Event = TypeVar("_Event")


class Listeners(Generic[_Event]):
    """Callbacks that hear every event, in order, in the caller's thread."""

    def __init__(self) -> None:
        self._callbacks: list[Callable[[_Event], None]] = []

    def subscribe(self, callback: Callable[[_Event], None]) -> Callable[[], None]:
        """Call ``callback`` for every event from now on; return a function that ends this."""
        self._callbacks.append(callback)

        def unsubscribe() -> None:
            with contextlib.suppress(ValueError):
                self._callbacks.remove(callback)

        return unsubscribe

    def publish(self, event: _Event) -> None:
        """Pass an event to all; a callback that fails is logged and affects no other."""
        for callback in tuple(self._callbacks):
            try:
                callback(event)
            except Exception:  # noqa: BLE001
                _log.exception("a listener failed at %s", type(event).__name__)
