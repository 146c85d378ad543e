"""A server over the peer engine, in an event loop of the test's own."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from typing import Any

from app.messages import EngineState, OpenSource
from app.server import Server
from app.storage import Storage


@asynccontextmanager
async def started(
    peer: Any, storage: Storage, source: str = "simulated:lab", drive: Any = None
) -> AsyncIterator[Server]:
    """A server whose first source is open, or refused."""
    server = Server(peer, storage, source=source, drive=drive)
    try:
        await server.start()
        await until(lambda: server.source.state.state is not EngineState.IDLE)
        yield server
    finally:
        await server.stop()


def run(scenario: Coroutine[Any, Any, None], within_s: float = 60) -> None:
    """What a test does, to its end."""

    async def limited() -> None:
        async with asyncio.timeout(within_s):
            await scenario

    asyncio.run(limited())


async def until(condition: Callable[[], Any]) -> None:
    """Wait until something holds, within a time that only a fault can reach."""
    async with asyncio.timeout(20):
        while not condition():
            await asyncio.sleep(0.005)


def opens(peer: Any) -> list[OpenSource]:
    """The sources that the engine was told to open."""
    return [command for command in peer.commands if isinstance(command, OpenSource)]
