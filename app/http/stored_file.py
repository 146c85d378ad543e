"""Response with a file of the server's that does not change, for downloads that can be resumed."""

from __future__ import annotations

import asyncio
import os
import re

from starlette.datastructures import Headers
from starlette.responses import FileResponse
from starlette.staticfiles import NotModifiedResponse
from starlette.types import Receive, Scope, Send

from app.http.etags import has_already

# RFC 9110, 14.1.2: one part of a Range header; longer numbers are no positions in a file.
_PART = re.compile(r"\s*(?:(\d{1,18})-(\d{1,18})?|-(\d{1,18}))\s*")


class StoredFileResponse(FileResponse):
    """File, or 304 if the client has it already; an invalid Range header is ignored."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        headers = Headers(scope=scope)
        self.stat_result = await asyncio.to_thread(os.stat, self.path)
        self.set_stat_headers(self.stat_result)
        if has_already(headers, self.headers["etag"]):
            return await NotModifiedResponse(self.headers)(scope, receive, send)
        if "range" in headers and not _is_valid(headers["range"]):
            kept = [(name, value) for name, value in scope["headers"] if name != b"range"]
            scope = {**scope, "headers": kept}
        return await super().__call__(scope, receive, send)


def _is_valid(range: str) -> bool:
    """Return whether a Range header asks for bytes, each part from a start to a later end."""
    unit, _, parts = range.partition("=")
    if unit.strip().lower() != "bytes":
        return False
    found = [_PART.fullmatch(part) for part in parts.split(",")]
    return all(
        one is not None and (one[1] is None or one[2] is None or int(one[1]) <= int(one[2]))
        for one in found
    )
