"""Open connections that end together with what admitted them."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any


@dataclass(eq=False, kw_only=True)
class Connections:
    """Session or read-only link, which admits connections for as long as it is valid.

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
    """Run a connection's job, cancelled when its session or link ends; return whether it ended."""
    task = asyncio.ensure_future(job)
    with by.connected(task.cancel):
        try:
            await task
        except asyncio.CancelledError:
            # Otherwise the server is shutting down and cancels this task.
            caller = asyncio.current_task()
            if not by.over or (caller is not None and caller.cancelling()):
                raise
    return by.over
