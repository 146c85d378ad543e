"""Shared code of all WebSocket routes: reading without trust, closing without noise."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Coroutine
from typing import Any

from fastapi import WebSocket
from starlette.websockets import WebSocketDisconnect, WebSocketState

from app.contract.values import JsonObject

INVALID_DATA = 1007
GOING_AWAY = 1001
TRY_LATER = 1013

_LONGEST_JSON = 1000
# Part of the error that uvicorn raises for a message sent after the end of the connection.
_SENT_TOO_LATE = "after sending 'websocket.close'"


class BadMessage(Exception):
    """Message that the route does not understand."""


async def receive_text(socket: WebSocket) -> str:
    """Return the next text message.

    Raises:
        BadMessage: the message was binary. WebSocketDisconnect: the client left.
    """
    message = await socket.receive()
    if message["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(message.get("code", 1005))
    text = message.get("text")
    if not isinstance(text, str):
        raise BadMessage("this socket accepts only text messages")
    return text


def json_object(text: str, expected: str) -> JsonObject:
    """Parse the JSON object that a client sent.

    Args:
        expected: tells the client what to send, if the text is not an object or too long.

    Raises:
        BadMessage: the text is unusable; the message is ``expected``.
    """
    if len(text) > _LONGEST_JSON:
        raise BadMessage(expected)
    try:
        message: Any = json.loads(text)
    except (ValueError, RecursionError):
        raise BadMessage(expected) from None
    if not isinstance(message, dict):
        raise BadMessage(expected)
    return message


async def until_one_ends(socket: WebSocket, *jobs: Coroutine[Any, Any, None]) -> None:
    """Run a socket's reader and writer; the first to end ends the other.

    A client that leaves is no error; one that sends nonsense is told so and closed with 1007.
    """
    tasks = [asyncio.ensure_future(job) for job in jobs]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        results = await asyncio.gather(*tasks, return_exceptions=True)
    for result in results:
        if isinstance(result, BadMessage):
            await close(socket, INVALID_DATA, str(result))
        elif isinstance(result, BaseException) and not _is_ordinary(result):
            raise result


def _is_ordinary(end: BaseException) -> bool:
    """Return whether a socket's job ended because its client left or was disconnected."""
    if isinstance(end, RuntimeError):
        # The server closed it because of what the client sent, before telling us.
        return _SENT_TOO_LATE in str(end)
    return isinstance(end, (asyncio.CancelledError, WebSocketDisconnect))


async def close(socket: WebSocket, code: int, reason: str = "") -> None:
    """Close the socket if still possible. A reason has at most 123 bytes on the wire."""
    if (
        socket.application_state is WebSocketState.CONNECTED
        and socket.client_state is WebSocketState.CONNECTED
    ):
        try:
            await socket.close(code, reason.encode()[:123].decode(errors="ignore"))
        except (RuntimeError, WebSocketDisconnect):
            # The client closed first.
            return
