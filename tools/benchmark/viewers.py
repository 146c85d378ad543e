"""Viewers without a browser: clients that drain the 3D scene, telemetry and one live view."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import threading
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import viser
from websockets.asyncio.client import ClientConnection, connect
from websockets.typing import Subprotocol

from app.client.server_process import MeasurementError, RunningServer

# At the lowest priority, beside a busy server, closing the connections takes long.
_STOP_TIMEOUT_S = 120.0
_LOWEST_PRIORITY = 19


@dataclass
class Drained:
    """Messages received so far by all clients together."""

    scene: int = 0
    observations: int = 0
    images: int = 0
    failures: list[str] = field(default_factory=list)


@contextmanager
def viewers(server: RunningServer, count: int) -> Iterator[Drained]:
    """Run ``count`` viewers on a separate thread during the block.

    Each one drains the scene (``/viewer``), acknowledges every observation (``/api/live``) and
    every image of the view ``left``, as the page does.
    """
    with _clients(server, (_drain_scene, _drain_live, _drain_view) * count) as drained:
        yield drained


@contextmanager
def stalled_viewer(server: RunningServer) -> Iterator[Drained]:
    """Run one viewer that signs in everywhere and then reads nothing, during the block."""
    with _clients(server, (_stall,)) as drained:
        yield drained


@contextmanager
def scene_viewer(server: RunningServer) -> Iterator[Drained]:
    """Run one viewer of the 3D scene alone, dense cloud included, during the block."""
    with _clients(server, (_drain_scene,)) as drained:
        yield drained


@contextmanager
def _clients(
    server: RunningServer,
    clients: Sequence[Callable[[RunningServer, Drained], Coroutine[Any, Any, None]]],
) -> Iterator[Drained]:
    drained = Drained()
    loop = asyncio.new_event_loop()
    stopping = asyncio.Event()

    async def all_of_them() -> None:
        tasks = [asyncio.create_task(client(server, drained)) for client in clients]
        await stopping.wait()
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    def run() -> None:
        # Real viewers run on other computers and take no processor time from the server, so these
        # only get the time that it leaves.
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _LOWEST_PRIORITY)
        loop.run_until_complete(all_of_them())

    thread = threading.Thread(target=run, name="benchmark-viewers")
    thread.start()
    try:
        yield drained
    finally:
        loop.call_soon_threadsafe(stopping.set)
        thread.join(_STOP_TIMEOUT_S)
        if thread.is_alive():
            raise MeasurementError(f"the viewers did not leave within {_STOP_TIMEOUT_S:g} s")
        loop.close()


async def _drain_scene(server: RunningServer, drained: Drained) -> None:
    async with _drained_socket(server, "/viewer", drained, f"viser-v{viser.__version__}") as socket:
        async for _ in socket:
            drained.scene += 1


async def _drain_live(server: RunningServer, drained: Drained) -> None:
    async with _drained_socket(server, "/api/live", drained) as socket:
        async for text in socket:
            message = json.loads(text)
            if message["type"] == "observation":
                drained.observations += 1
                await socket.send(json.dumps({"type": "painted", "sequence": message["sequence"]}))


async def _drain_view(server: RunningServer, drained: Drained) -> None:
    async with _drained_socket(server, "/api/views/left", drained) as socket:
        async for _ in socket:
            drained.images += 1
            await socket.send("ack")


async def _stall(server: RunningServer, drained: Drained) -> None:
    scene = _drained_socket(server, "/viewer", drained, f"viser-v{viser.__version__}")
    live, view = (
        _drained_socket(server, path, drained) for path in ("/api/live", "/api/views/left")
    )
    async with scene as a, live as b, view as c:
        try:
            # Messages that nobody reads fill the socket's queue, and then the connection.
            await asyncio.get_running_loop().create_future()
        finally:
            # The reply to a close handshake would wait behind all that was not read.
            for socket in (a, b, c):
                socket.transport.abort()


@contextlib.asynccontextmanager
async def _drained_socket(
    server: RunningServer, path: str, drained: Drained, subprotocol: str = ""
) -> AsyncIterator[ClientConnection]:
    try:
        async with server_socket(server, path, subprotocol) as socket:
            yield socket
    except Exception as error:
        # A failed viewer must appear in the figures, not vanish from them.
        drained.failures.append(f"{path}: {error}")
        raise


def server_socket(server: RunningServer, path: str, subprotocol: str = "") -> connect:
    """Return a connection to enter, signed in as an operator."""
    return connect(
        f"ws://127.0.0.1:{server.port}{path}",
        additional_headers={"Authorization": f"Bearer {server.token}"},
        subprotocols=[Subprotocol(subprotocol)] if subprotocol else None,
        compression=None,
        max_size=None,
        proxy=None,
    )
