"""The gate in front of every route, mount and WebSocket, new ones included.

Pure ASGI, because the framework's HTTP middleware never sees WebSockets and dependencies never see
mounts. Checks run in this order: name (400), origin (403), token or session (401, 429), access
(403), kind of body (415), size (413).
"""

from __future__ import annotations

import contextlib
import html
import json
from collections.abc import Mapping
from dataclasses import dataclass
from urllib.parse import parse_qsl

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.http.gate.access import SAFE_METHODS, WATCHING_ONLY
from app.http.gate.admission import Admission, Refusal, access_of, connections_of, header_values
from app.http.gate.bodies import LimitedBody, accepts_kind
from app.http.gate.connections import run_connected
from app.http.gate.headers import RawHeaders, page_policy, secured
from app.http.gate.origins import Names, NetworkName, parse_host

PUBLIC_PATHS = frozenset({"/healthz", "/readyz", "/sign-in"})
# A multipart body adds boundaries and headers to the file.
_UPLOAD_OVERHEAD = 16 * 1024
_QUOTED = 80
# Tells a page that its session has ended, and not merely its connection.
SESSION_OVER = 4401
_PLACE_OF_REFUSAL = "<!-- refusal -->"


@dataclass(frozen=True)
class Policy:
    """Access rules: who may come in, and with how much data.

    Attributes:
        names: names the server answers to.
        admission: checks tokens and sessions.
        body_max_bytes: largest body. uploads: largest file for each path that takes files.
        sign_in_page: shown to a browser that has not signed in.
    """

    names: Names
    admission: Admission
    body_max_bytes: int
    uploads: Mapping[str, int]
    sign_in_page: str


class Gate:
    """ASGI middleware that admits requests by the policy."""

    def __init__(self, app: ASGIApp, policy: Policy) -> None:
        self._app = app
        self._policy = policy

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
        elif scope["type"] == "websocket":
            await self._websocket(scope, receive, send)
        else:
            await self._http(scope, receive, _with_security_headers(send))

    async def _websocket(self, scope: Scope, receive: Receive, send: Send) -> None:
        refusal = self._refuse_sender(scope) or self._policy.admission.admit(scope)
        if refusal is not None:
            await _deny(scope, refusal, send)
            return
        job = self._app(scope, receive, send)
        by = connections_of(scope)
        if by is None:
            await job
        elif await run_connected(by, job):
            # It may have been closed already.
            with contextlib.suppress(RuntimeError, OSError):
                await send(
                    {"type": "websocket.close", "code": SESSION_OVER, "reason": "signed out"}
                )

    async def _http(self, scope: Scope, receive: Receive, send: Send) -> None:
        refusal = self._refuse_sender(scope)
        if refusal is not None:
            await _refuse(scope, receive, send, refusal)
            return
        path, method = scope["path"], scope["method"]
        if path == "/" and method in ("GET", "HEAD"):
            query = parse_qsl(scope["query_string"].decode("latin-1"))
            linked = [value for key, value in query if key == "token"]
            if linked:
                await self._follow_link(scope, linked, send)
                return
        if path not in PUBLIC_PATHS:
            refusal = self._policy.admission.admit(scope)
            if refusal is not None and method == "GET" and wants_page(scope):
                await _send_page(send, refusal, self._policy.sign_in_page)
                return
            if refusal is None and not access_of(scope).allows(method, path):
                refusal = Refusal(403, WATCHING_ONLY)
        refusal = refusal or self._refuse_body(scope)
        if refusal is not None:
            await _refuse(scope, receive, send, refusal)
            return
        most_bytes = self._most_bytes(path)
        body = LimitedBody(receive, send, most_bytes, comes=_has_body(scope))
        if await body.run(self._app, scope):
            await _refuse(scope, receive, send, _too_large(most_bytes))

    async def _follow_link(self, scope: Scope, tokens: list[str], send: Send) -> None:
        """Exchange the token in the link for a session and remove it from the address."""
        cookie = await self._policy.admission.sign_in(scope, tokens)
        if isinstance(cookie, Refusal):
            await _send_page(send, cookie, self._policy.sign_in_page)
            return
        headers = [(b"location", b"/"), (b"set-cookie", cookie.encode())]
        await _answer_raw(send, 303, headers, b"")

    def _refuse_sender(self, scope: Scope) -> Refusal | None:
        """Check the addressed name and the sending page."""
        names = self._policy.names
        hosts = header_values(scope, b"host")
        host = parse_host(hosts[0]) if len(hosts) == 1 else None
        if host is None:
            return Refusal(400, "the request needs exactly one Host header with the server's name")
        if not names.answers_to(host):
            return Refusal(
                400,
                f"this server does not accept the name {host.name[:_QUOTED]}; start it with "
                f"--allowed-host {host.name[:_QUOTED]} if it should",
            )
        return self._refuse_page(scope, host)

    def _refuse_page(self, scope: Scope, host: NetworkName) -> Refusal | None:
        origins = header_values(scope, b"origin")
        for origin in origins:
            # The sandboxed page of the 3D scene; its key admits it to nothing else.
            if origin == "null" and self._policy.admission.viewed(scope) is not None:
                continue
            if not self._policy.names.accepts_origin(origin, host):
                return Refusal(
                    403,
                    f"pages of {_printable(origin)} may not use this server; "
                    f"start it with --allowed-host NAME to serve it under that name",
                )
        acts = scope["type"] == "websocket" or scope["method"] not in SAFE_METHODS
        # Browsers set this header themselves; it also covers requests that hide the origin.
        sites = header_values(scope, b"sec-fetch-site")
        if acts and not origins and any(site not in ("same-origin", "none") for site in sites):
            return Refusal(
                403,
                "pages of other sites may not use this server; open its own page, or start it "
                "with --allowed-host NAME to serve it under that name",
            )
        return None

    def _refuse_body(self, scope: Scope) -> Refusal | None:
        if scope["method"] in SAFE_METHODS:
            return None
        kinds = header_values(scope, b"content-type")
        kind = kinds[0] if kinds else None
        if len(kinds) > 1 or not accepts_kind(scope["path"], kind, _has_body(scope)):
            return Refusal(415, "send the body as application/json, and say so in Content-Type")
        most_bytes = self._most_bytes(scope["path"])
        return _too_large(most_bytes) if _announced_bytes(scope) > most_bytes else None

    def _most_bytes(self, path: str) -> int:
        file_bytes = self._policy.uploads.get(path)
        if file_bytes is None:
            return self._policy.body_max_bytes
        return file_bytes + _UPLOAD_OVERHEAD


def _too_large(most_bytes: int) -> Refusal:
    return Refusal(413, f"the request body is too large; at most {most_bytes} bytes are accepted")


def _announced_bytes(scope: Scope) -> int:
    lengths = header_values(scope, b"content-length")
    return int(lengths[0]) if lengths and lengths[0].isdecimal() else 0


def _has_body(scope: Scope) -> bool:
    return _announced_bytes(scope) > 0 or bool(header_values(scope, b"transfer-encoding"))


def wants_page(scope: Scope) -> bool:
    """Return whether the answer is for a person to read."""
    return any("text/html" in value for value in header_values(scope, b"accept"))


def _printable(text: str) -> str:
    return "".join(c for c in text[:_QUOTED] if c.isprintable())


def _with_security_headers(send: Send) -> Send:
    async def wrapped(message: Message) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": secured(message.get("headers", ()))}
        await send(message)

    return wrapped


async def _refuse(scope: Scope, receive: Receive, send: Send, refusal: Refusal) -> None:
    body = json.dumps({"detail": refusal.detail}).encode()
    headers = [(b"content-type", b"application/json"), *refusal.headers]
    unwanted = LimitedBody(receive, send, 0, comes=_has_body(scope))
    await _answer_raw(unwanted.send, refusal.status, headers, body)


def sign_in_headers(page: str) -> dict[str, str]:
    """Return the headers with which the sign-in page is sent."""
    return {
        "Content-Security-Policy": page_policy(page),
        # With "no-referrer" browsers would hide the form's origin, which we require.
        "Referrer-Policy": "same-origin",
    }


def refused_page(page: str, refusal: Refusal) -> str:
    """Return the sign-in page, with the refusal's reason where that says more than the page."""
    if not refusal.on_page:
        return page
    # How to sign in, which follows the reason, is what the page says below.
    reason = refusal.detail.partition(";")[0] if refusal.status == 401 else refusal.detail
    detail = html.escape(reason[:1].upper() + reason[1:])
    return page.replace(_PLACE_OF_REFUSAL, f'<p role="alert">{detail}.</p>')


async def _send_page(send: Send, refusal: Refusal, page: str) -> None:
    body = refused_page(page, refusal)
    headers = [
        (b"content-type", b"text/html; charset=utf-8"),
        *((name.lower().encode(), value.encode()) for name, value in sign_in_headers(page).items()),
        *refusal.headers,
    ]
    await _answer_raw(send, refusal.status, headers, body.encode())


async def _answer_raw(
    send: Send,
    status: int,
    headers: RawHeaders,
    body: bytes,
    *,
    kind: str = "http.response",
) -> None:
    headers = [*headers, (b"content-length", str(len(body)).encode())]
    await send({"type": f"{kind}.start", "status": status, "headers": headers})
    await send({"type": f"{kind}.body", "body": body})


async def _deny(scope: Scope, refusal: Refusal, send: Send) -> None:
    """Refuse a WebSocket within its handshake, with status and reason if the server can."""
    if "websocket.http.response" not in scope.get("extensions", {}):
        await send({"type": "websocket.close", "code": 1008, "reason": refusal.detail[:100]})
        return
    body = json.dumps({"detail": refusal.detail}).encode()
    headers = secured([(b"content-type", b"application/json"), *refusal.headers])
    kind = "websocket.http.response"
    await _answer_raw(send, refusal.status, headers, body, kind=kind)
