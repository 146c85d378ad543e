"""Requests and handshakes as raw bytes."""

from __future__ import annotations

import asyncio
from typing import Any

from websockets.exceptions import InvalidStatus


def bearer() -> str:
    return "Bearer a-token-of-the-tests-with-256-bits-more-or-less"


async def refusal(served: Any, path: str, *, headers: Any = (), **more: Any) -> int:
    """Return the status with which a handshake is refused; 101 if it is accepted."""
    host = dict(headers).pop("Host", None)
    kept = {name: value for name, value in dict(headers).items() if name != "Host"}
    if host is not None:
        return await raw_handshake(served.port, path, host)
    try:
        async with served.socket(path, headers=kept, **more):
            return 101
    except InvalidStatus as error:
        return error.response.status_code


async def raw_handshake(port: int, path: str, host: str) -> int:
    lines = [
        f"GET {path} HTTP/1.1",
        f"Host: {host}",
        f"Authorization: {bearer()}",
        "Connection: Upgrade",
        "Upgrade: websocket",
        "Sec-WebSocket-Version: 13",
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
        "",
        "",
    ]
    return int((await raw(port, "\r\n".join(lines).encode())).split()[1])


async def raw_request(port: int, method: str, path: str, headers: dict[str, str]) -> bytes:
    sent = {"Host": f"127.0.0.1:{port}", "Authorization": bearer(), **headers}
    lines = [f"{method} {path} HTTP/1.1", *(f"{k}: {v}" for k, v in sent.items()), "", ""]
    return await raw(port, "\r\n".join(lines).encode())


async def raw(port: int, data: bytes) -> bytes:
    """Send raw bytes and read the head of the answer."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    try:
        writer.write(data)
        await writer.drain()
        async with asyncio.timeout(10):
            return await reader.readuntil(b"\r\n\r\n") + await reader.read(2000)
    except asyncio.IncompleteReadError as error:
        return error.partial
    finally:
        writer.close()
