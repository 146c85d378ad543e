"""A server that stops while a socket is being opened: it is refused, and nothing is logged."""

from __future__ import annotations

import asyncio
import logging
import time
from pathlib import Path
from typing import Any

import pytest
import uvicorn

from app.http.gate.strangers import Strangers
from app.http.run_server import server_config
from app.settings import Settings

_HANDSHAKE = (
    b"GET / HTTP/1.1\r\nHost: here\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
    b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
)


@pytest.mark.parametrize("accepts", [False, True])
async def test_a_socket_that_a_stop_leaves_unopened_is_refused_silently(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, accepts: bool
) -> None:
    opening = asyncio.Event()

    async def app(_scope: Any, _receive: Any, send: Any) -> None:
        opening.set()
        # Act at once when the server closes the connection, before it hears that it is closed.
        while not all(each.transport.is_closing() for each in server.server_state.connections):
            await asyncio.sleep(0)
        if accepts:
            await send({"type": "websocket.accept"})
            await send({"type": "websocket.send", "text": "too late"})

    settings = Settings(data=tmp_path, host="127.0.0.1", port=0)
    server = uvicorn.Server(server_config(app, settings, Strangers(time.monotonic)))  # type: ignore[arg-type]
    server.config.port = 0
    serving = asyncio.create_task(server.serve())
    while not server.started:
        await asyncio.sleep(0.01)
    host, port = server.servers[0].sockets[0].getsockname()[:2]
    reader, writer = await asyncio.open_connection(host, port)
    writer.write(_HANDSHAKE)
    await opening.wait()
    server.should_exit = True
    await serving
    assert (await reader.read()).startswith(b"HTTP/1.1 500")
    writer.close()
    said = [each.getMessage() for each in caplog.records if each.levelno >= logging.WARNING]
    assert said == []
