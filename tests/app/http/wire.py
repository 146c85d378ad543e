"""Raw data that the tests send to the server and read from it."""

from __future__ import annotations

from typing import Any

JSON = {"Content-Type": "application/json"}
# The head of a file in a form whose boundary is x.
UPLOAD_HEAD = b'--x\r\nContent-Disposition: form-data; name="file"; filename="a"\r\n\r\n'


async def read_on(socket: Any) -> None:
    """Read until the connection ends."""
    while True:
        await socket.recv()
