"""Files and answers sent compressed to clients that accept gzip."""

from __future__ import annotations

import gzip
import os
from functools import lru_cache, partial
from pathlib import Path

import anyio.to_thread
from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import FileResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

# Pictures and fonts are compressed already.
_SHRINKING = ("text/", "image/svg+xml", "application/json", "application/xml")
# Below this, compression saves nothing: the file fits in one packet anyway.
_LEAST_BYTES = 500
# Headers that the compressed response sets itself or omits.
_OF_PLAIN_BYTES = ("accept-ranges", "content-length", "etag")
# Compressed files kept in the cache; the panel has about 170.
_KEPT_FILES = 512


class CompressedAnswers:
    """Middleware that compresses whole JSON answers; files are not: downloads may be resumed."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or not takes_gzip(Headers(scope=scope)):
            await self._app(scope, receive, send)
            return
        held: Message | None = None

        async def compressed(message: Message) -> None:
            nonlocal held
            if message["type"] == "http.response.start" and _is_json(message):
                held = message
                return
            if held is not None:
                message = await _shrunk(held, message)
                await send(held)
                held = None
            await send(message)

        await self._app(scope, receive, compressed)


def _is_json(start: Message) -> bool:
    headers = Headers(raw=start["headers"])
    encoded = "content-encoding" in headers or "accept-ranges" in headers
    return headers.get("content-type") == "application/json" and not encoded


async def _shrunk(start: Message, body: Message) -> Message:
    """Return the message with the whole body compressed, as ``start`` then says."""
    plain = body.get("body", b"")
    if body.get("more_body") or len(plain) < _LEAST_BYTES:
        return body
    shrunk = await anyio.to_thread.run_sync(_gzipped, plain)
    headers = MutableHeaders(raw=start["headers"])
    headers["content-encoding"], headers["content-length"] = "gzip", str(len(shrunk))
    headers.add_vary_header("Accept-Encoding")
    return {**body, "body": shrunk}


def _gzipped(content: bytes) -> bytes:
    """Return the content compressed, the same bytes each time (``mtime`` 0)."""
    return gzip.compress(content, 6, mtime=0)


def takes_gzip(headers: Headers) -> bool:
    """Return whether the sender of a request accepts gzip."""
    offered = headers.get("accept-encoding", "").lower().split(",")
    return any(
        coding.strip() == "gzip" and weight.replace(" ", "") not in ("q=0", "q=0.0")
        for coding, _, weight in (each.partition(";") for each in offered)
    )


class CompressedFile(FileResponse):
    """File sent compressed where that saves something and the client accepts it; partial content
    (``Range``) is never compressed.
    """

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        state = self.stat_result
        if state is None:
            state = await anyio.to_thread.run_sync(os.stat, self.path)
        media = self.media_type or ""
        if not media.startswith(_SHRINKING) or state.st_size < _LEAST_BYTES:
            return await super().__call__(scope, receive, send)
        self.headers["vary"] = "Accept-Encoding"
        asked = Headers(scope=scope)
        if "range" in asked or not takes_gzip(asked):
            return await super().__call__(scope, receive, send)
        self.set_stat_headers(state)
        compress = partial(_compressed, Path(self.path), state.st_mtime_ns, state.st_size)
        body = await anyio.to_thread.run_sync(compress)
        kept = {name: value for name, value in self.headers.items() if name not in _OF_PLAIN_BYTES}
        # The same content in different bytes calls for a weak ETag.
        own = {"content-encoding": "gzip", "etag": f"W/{self.headers['etag']}"}
        return await Response(body, self.status_code, kept | own)(scope, receive, send)


@lru_cache(maxsize=_KEPT_FILES)
def _compressed(path: Path, changed_ns: int, size: int) -> bytes:  # noqa: ARG001 - the key
    return _gzipped(path.read_bytes())
