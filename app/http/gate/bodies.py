"""Limits on a request's body: its real size and its kind."""

from __future__ import annotations

import asyncio
import contextlib

from starlette.types import ASGIApp, Message, Receive, Scope, Send

JSON_KIND = "application/json"
FORM_KIND = "application/x-www-form-urlencoded"
UPLOAD_KIND = "multipart/form-data"

# Seconds and bytes for which an unwanted body is still read.
_LINGER_S = 1.0
_LINGER_BYTES = 8 * 1024 * 1024

# A cross-site page can send forms and plain text without a preflight request, so no route accepts
# these unless it is listed here.
_FURTHER_KINDS = {
    "/sign-in": FORM_KIND,
    "/api/calibrations": UPLOAD_KIND,
    "/api/calibrating/images": UPLOAD_KIND,
    "/api/truth": UPLOAD_KIND,
}


def accepts_kind(path: str, content_type: str | None, has_body: bool) -> bool:
    """Return whether a request of this ``Content-Type`` is accepted at ``path``."""
    if content_type is None:
        return not has_body
    kind = content_type.partition(";")[0].strip().lower()
    return kind == JSON_KIND or kind == _FURTHER_KINDS.get(path)


class BodyTooLarge(Exception):
    """Body with more bytes than the route accepts."""


class LimitedBody:
    """Counter of a body's bytes as they arrive, whatever ``Content-Length`` claims.

    Use ``receive`` and ``send`` in place of the connection's own: once the limit is passed, the
    application fails to read and its reply is dropped, so that the caller can refuse the request.
    A connection whose body the application left unread serves no other request. It is closed after
    a moment; if closed at once, a client that is still sending would never see the reply.

    Args:
        comes: whether the request has a body at all.
    """

    def __init__(self, receive: Receive, send: Send, most_bytes: int, *, comes: bool) -> None:
        self._receive = receive
        self._send = send
        self._left = most_bytes
        self._comes = comes
        self._started = False
        self._closes = False
        self.exceeded = False

    async def receive(self) -> Message:
        message = await self._receive()
        if message["type"] == "http.request":
            self._comes = bool(message.get("more_body", False))
            self._left -= len(message.get("body", b""))
            if self._left < 0:
                self.exceeded = True
                raise BodyTooLarge
        return message

    async def send(self, message: Message) -> None:
        if self.exceeded and not self._started:
            return
        if message["type"] == "http.response.start":
            self._closes = self._comes
            if self._closes:
                headers = [*message.get("headers", ()), (b"connection", b"close")]
                message = {**message, "headers": headers}
        elif self._closes and not message.get("more_body", False):
            await self._send({**message, "more_body": True})
            await self._linger()
            message = {"type": "http.response.body", "body": b""}
        self._started = True
        await self._send(message)

    async def run(self, app: ASGIApp, scope: Scope) -> bool:
        """Run the application; return True if the body was too large and no reply was sent."""
        try:
            await app(scope, self.receive, self.send)
        except BodyTooLarge:
            if self._started:
                raise
        return self.exceeded and not self._started

    async def _linger(self) -> None:
        """Read on for a moment, so that the sender of a body receives the reply."""
        left = _LINGER_BYTES
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_LINGER_S):
                while left > 0:
                    message = await self._receive()
                    if message["type"] != "http.request" or not message.get("more_body", False):
                        return
                    left -= len(message.get("body", b""))
