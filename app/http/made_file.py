"""Response that streams a file without a name."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from app.server.runs.files import MadeFile

_CHUNK = 256 * 1024
_QUOTED = '"\\'


class MadeFileResponse(Response):
    """Response that streams the file and closes it, even if the client leaves early."""

    def __init__(
        self,
        made: MadeFile,
        media_type: str,
        *,
        inline: bool = False,
        headers: Mapping[str, str] | None = None,
    ) -> None:
        self.status_code = 200
        self.media_type = media_type
        self.background = None
        self._made = made
        name = "".join(c for c in made.name if c.isascii() and c.isprintable() and c not in _QUOTED)
        kind = "inline" if inline else "attachment"
        self.body = b""
        self.init_headers(
            {
                "content-length": str(made.size),
                "content-disposition": f'{kind}; filename="{name}"',
                **(headers or {}),
            }
        )

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        del scope, receive
        with self._made.file as file:
            await send(
                {
                    "type": "http.response.start",
                    "status": self.status_code,
                    "headers": self.raw_headers,
                }
            )
            left = self._made.size
            while left:
                chunk = await asyncio.to_thread(file.read, min(_CHUNK, left))
                left = left - len(chunk) if chunk else 0
                await send({"type": "http.response.body", "body": chunk, "more_body": left > 0})
