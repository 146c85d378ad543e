"""Views and clouds being watched; the engine makes only these."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import structlog

from app.contract.commands import WatchViews
from app.runtime.errors import ProcessRefused, ProcessUnavailable
from app.server.contracts import Engine

log = structlog.get_logger(__name__)


class Watching:
    """Counter of watchers by view; it keeps the engine informed.

    Call all methods, and the functions they return, in the event loop's thread.
    """

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._watchers: Counter[str] = Counter()
        self._changed = asyncio.Event()
        self._requested: tuple[str, ...] | None = None

    @contextmanager
    def watch(self, *names: str) -> Iterator[None]:
        """Have these views made while the block runs."""
        leave = self.enter(*names)
        try:
            yield
        finally:
            leave()

    def enter(self, *names: str) -> Callable[[], None]:
        """Have these views made until the returned function is called (once)."""
        self._watchers.update(names)
        self._changed.set()

        def leave() -> None:
            self._watchers.subtract(names)
            self._changed.set()

        return leave

    def is_watched(self, name: str) -> bool:
        """Return whether somebody is watching this view already."""
        return self._watchers[name] > 0

    def engine_started(self) -> None:
        """Tell a new engine everything again: it knows no watchers."""
        self._requested = None
        self._changed.set()

    async def run(self) -> None:
        """Tell the engine of every change, one request at a time, until cancelled."""
        while True:
            await self._changed.wait()
            self._changed.clear()
            names = tuple(sorted(name for name, count in self._watchers.items() if count > 0))
            if names == (self._requested or ()):
                continue
            try:
                await self._engine.request(WatchViews(names))
            except ProcessUnavailable:
                # The next engine is notified once it has started.
                self._requested = None
            except ProcessRefused as error:
                log.error("watched_views_refused", names=names, reason=str(error))
            else:
                self._requested = names
