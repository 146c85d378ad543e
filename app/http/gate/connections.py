"""Open connections that end together with what admitted them."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any


@dataclass(eq=False, kw_only=True)
class Connections:
    """What admits connections for as long as it is in force: a session, or a read-only link.

    Attributes:
        over: whether it has ended. closers: each closes one of its open connections.
    """

    over: bool = False
    closers: set[Callable[[], Any]] = field(default_factory=set)

    @contextmanager
    def connected(self, closer: Callable[[], Any]) -> Iterator[None]:
        """Have ``closer`` called if this ends while the block runs."""
        self.closers.add(closer)
        try:
            yield
        finally:
            self.closers.discard(closer)

    def end(self) -> None:
        """Close every connection."""
        self.over = True
        for close in tuple(self.closers):
            close()


async def run_connected(by: Connections, job: Awaitable[None]) -> bool:
    """Run a connection's job, cancelled where what admitted it ends; return whether it did."""
    task = asyncio.ensure_future(job)
    with by.connected(task.cancel):
        try:
            await task
        except asyncio.CancelledError:
            # Otherwise it is the server that shuts down, and cancels this one.
            caller = asyncio.current_task()
            if not by.over or (caller is not None and caller.cancelling()):
                raise
    return by.over
