"""Images of the live views for any number of watchers: read once, and only while watched."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from app.runtime.latest import Latest
from app.server import Server

# Half a frame period at 60 Hz: the added wait is not visible.
_POLL_S = 0.008


class ViewFeed:
    """Feed of one view. Shared memory cannot wake readers, so it is polled while it is watched."""

    def __init__(self, server: Server, name: str) -> None:
        self._server = server
        self._name = name
        self._watchers = 0
        self._polling: asyncio.Task[None] | None = None
        self._newest: Latest | None = None
        self._arrived = asyncio.Condition()

    @asynccontextmanager
    async def watched(self) -> AsyncIterator[None]:
        """Have the view drawn while the block runs."""
        # The image in the slot is old, unless somebody else has the view drawn already.
        skip = 0 if self._server.watching.is_watched(self._name) else self._last_drawn()
        with self._server.watching.watch(self._name):
            self._watchers += 1
            if self._polling is None:
                self._polling = asyncio.create_task(self._poll(skip), name=f"view {self._name}")
            try:
                yield
            finally:
                self._watchers -= 1
                if self._watchers == 0:
                    await self._end()

    async def newer(self, after: int) -> Latest:
        """Return the newest image, once its sequence is above ``after``."""
        async with self._arrived:
            while self._newest is None or self._newest.sequence <= after:
                await self._arrived.wait()
            return self._newest

    async def _end(self) -> None:
        polling, self._polling = self._polling, None
        self._newest = None
        if polling is not None:
            polling.cancel()
            await asyncio.gather(polling, return_exceptions=True)

    def _last_drawn(self) -> int:
        newest = self._server.engine.views[self._name].read(0)
        return 0 if newest is None else newest.sequence

    async def _poll(self, sequence: int) -> None:
        while True:
            newest = self._server.engine.views[self._name].read(sequence)
            if newest is not None:
                sequence = newest.sequence
                async with self._arrived:
                    self._newest = newest
                    self._arrived.notify_all()
            await asyncio.sleep(_POLL_S)
