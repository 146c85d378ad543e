"""Response that streams a file without a name."""

from __future__ import annotations

from collections.abc import AsyncIterator, Mapping
from functools import partial

from starlette.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from app.http.file_name import content_disposition
from app.server.runs.files import MadeFile

_CHUNK = 256 * 1024


class MadeFileResponse(StreamingResponse):
    """Response that streams the file and closes it, even if the client leaves early."""

    def __init__(
        self,
        made: MadeFile,
        media_type: str,
        *,
        inline: bool = False,
        headers: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(
            iter(partial(made.file.read, _CHUNK), b""),
            headers={
                "content-length": str(made.size),
                "content-disposition": content_disposition(
                    made.name, "inline" if inline else "attachment"
                ),
                **(headers or {}),
            },
            media_type=media_type,
        )
        self._file = made.file

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        with self._file:
            if scope["method"] == "HEAD":
                self.body_iterator = _nothing()
            await super().__call__(scope, receive, send)


async def _nothing() -> AsyncIterator[bytes]:
    nothing: tuple[bytes, ...] = ()
    for chunk in nothing:
        yield chunk
