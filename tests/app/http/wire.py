"""Raw data that the tests send to the server and read from it."""

from __future__ import annotations

import asyncio
import contextlib
from typing import Any

import psutil

JSON = {"Content-Type": "application/json"}
# The head of a file in a form whose boundary is x.
UPLOAD_HEAD = b'--x\r\nContent-Disposition: form-data; name="file"; filename="a"\r\n\r\n'


async def read_on(socket: Any) -> None:
    """Read until the connection ends."""
    while True:
        await socket.recv()


async def calibrating(http: Any) -> Any:
    """Return the facts of the calibration in progress."""
    return (await http.get("/api/calibrating")).json()["calibrating"]


async def upload_gigabytes(
    port: int, path: str, token: str, *, announced: bool
) -> tuple[bytes, int]:
    """Begin an upload of 2 GB, its length announced or not.

    Returns:
        The first line of the answer, and the memory the process took meanwhile, bytes.
    """
    process = psutil.Process()
    before = process.memory_info().rss
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    head = [
        f"POST {path} HTTP/1.1",
        f"Host: 127.0.0.1:{port}",
        f"Authorization: Bearer {token}",
        "Content-Type: multipart/form-data; boundary=x",
        f"Content-Length: {2 * 1024**3}" if announced else "Transfer-Encoding: chunked",
    ]
    writer.write("\r\n".join([*head, "", ""]).encode())
    parts = [UPLOAD_HEAD.ljust(65536, b"x"), *(600 * [b"x" * 65536])]
    # Like all clients, this one listens while it sends.
    answer = asyncio.ensure_future(reader.readline())
    most = 0
    with contextlib.suppress(ConnectionError):
        for part in parts:
            writer.write(part if announced else b"10000\r\n" + part + b"\r\n")
            await writer.drain()
            most = max(most, process.memory_info().rss)
    line = await answer
    writer.close()
    return line, most - before
