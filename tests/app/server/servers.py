"""A server over the peer engine."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from app.contract.commands import OpenSource
from app.contract.events import EngineState
from app.server import Server
from app.storage import Storage
from observer.robots.contract import RobotPort

from ...waiting import until_async

# The robots of a simulated lab.
LAB_ROBOTS = tuple(
    RobotPort(role, f"socket://127.0.0.1:{port}", model, f"the {role}")  # type: ignore[arg-type]
    for role, port, model in (("observer", 5001, "amigo-sh"), ("obstacle", 5002, "p3dx-sh"))
)


@asynccontextmanager
async def started(
    peer: Any, storage: Storage, source: str = "simulated:lab", drive: Any = None
) -> AsyncIterator[Server]:
    """Yield a server whose first source is open, or refused."""
    server = Server(peer, storage, source=source, drive=drive)
    try:
        await server.start()
        await until_async(lambda: server.source.state.state is not EngineState.IDLE)
        yield server
    finally:
        await server.stop()


async def begin(server: Server, **more: Any) -> Any:
    """Begin a run with the current settings, changed by ``more``, and return its record."""
    given = {"name": None, "source": None, "calibration_id": None, "preset": None}
    return await server.runs.start(**{**given, "parameters": {}, **more})


def opens(peer: Any) -> list[OpenSource]:
    """Return the sources that the engine was told to open."""
    return [command for command in peer.commands if isinstance(command, OpenSource)]
