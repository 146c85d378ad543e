"""Proxy for viser: its page, and its WebSocket, filtered.

viser has no authentication and listens on loopback only, where it admits only this proxy. Of the
messages from browsers only the camera pose passes: our scene needs nothing else, and some of the
others would expose the machine.

The page is sandboxed and sends no cookies, so each session has it under an address with a key.
"""

from __future__ import annotations

import asyncio
import gzip
import hashlib
from dataclasses import dataclass
from typing import Annotated

import msgspec
import structlog
from fastapi import APIRouter, Depends, Request, WebSocket
from fastapi.requests import HTTPConnection
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.websockets import WebSocketDisconnect
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.typing import Subprotocol

from app.http.compressed import takes_gzip
from app.http.errors import SafeJSON
from app.http.etags import has_already
from app.http.gate.admission import session_of
from app.http.gate.headers import VIEWER_POLICY
from app.http.sockets.connections import GOING_AWAY, BadMessage, close, until_one_ends
from app.viewer import NullViewer, Viewer

log = structlog.get_logger(__name__)

router = APIRouter(include_in_schema=False)

_OPEN_TIMEOUT_S = 5.0
# The client's page sends its camera fifty times a second at most.
_CAMERA_GAP_S = 0.01
# "No status" and "lost" exist only as reports, never on the wire.
_NEVER_SENT = (1005, 1006, 1015)
_LONGEST_SUBPROTOCOL = 100
# Scripts of ``static/app/scene-frame``, which let the client work in a sandbox and connect it to
# the panel around it.
_OUR_SCRIPTS = (
    b'<script src="app/module-workers.js" crossorigin></script>'
    b'<script src="app/viewer-link.js" crossorigin></script>'
    b'<script src="app/frame-pace.js" crossorigin></script>'
    b'<script type="module" src="app/main.js"></script>'
)
Vector = tuple[float, float, float]


class _Kind(msgspec.Struct):
    type: str


class _Camera(msgspec.Struct):
    """``ViewerCameraMessage`` of viser 1.1.1."""

    type: str
    wxyz: tuple[float, float, float, float]
    position: Vector
    fov: float
    near: float
    far: float
    image_height: float
    image_width: float
    look_at: Vector
    up_direction: Vector


_kind = msgspec.msgpack.Decoder(_Kind)
_camera = msgspec.msgpack.Decoder(_Camera)


@dataclass(frozen=True)
class PreparedPage:
    """The client's page as it is sent."""

    plain: bytes
    compressed: bytes
    tag: str


def prepared_page(page: bytes) -> PreparedPage:
    """Return viser's page with our scripts in it, before its own."""
    page = page.replace(b"<head>", b"<head>" + _OUR_SCRIPTS, 1)
    tag = f'"{hashlib.sha256(page).hexdigest()[:32]}"'
    return PreparedPage(page, gzip.compress(page, 6), tag)


class ViewerDoor:
    """Gives the routes access to the viewer, which may start late or not at all."""

    def __init__(self) -> None:
        self.viewer: Viewer = NullViewer("the 3D viewer is starting")
        self.page = PreparedPage(b"", b"", "")
        self.opened = False

    def open(self, viewer: Viewer) -> None:
        """Admit clients to a viewer. Takes a moment; call it in a thread."""
        if viewer.port is not None:
            self.page = prepared_page(viewer.page())
        self.viewer = viewer
        self.opened = True


def _door(connection: HTTPConnection) -> ViewerDoor:
    door = connection.app.state.viewer
    assert isinstance(door, ViewerDoor)
    return door


Door = Annotated[ViewerDoor, Depends(_door)]


@router.get("/viewer")
async def viewer_without_slash() -> Response:
    """The client finds its WebSocket from the page's address, which needs the slash."""
    return RedirectResponse("/viewer/", 307)


@router.get("/viewer/")
async def viewer_page(request: Request, door: Door) -> Response:
    """Send a browser to the scene's page for its session; scripts with the token get it here."""
    session = session_of(request.scope)
    if session is not None:
        return RedirectResponse(f"/viewer/{session.viewer_key}/", 307)
    return await viewer_page_of_session(request, door)


@router.get("/viewer/{key}/")
async def viewer_page_of_session(request: Request, door: Door) -> Response:
    """viser's client, one file."""
    if door.viewer.port is None:
        # No browser heeds Retry-After in a frame.
        again = "" if door.opened else '<meta http-equiv="refresh" content="1">'
        words = f"<p>The 3D view is unavailable: {door.viewer.trouble}.</p>"
        return HTMLResponse(again + words, 503, {"Retry-After": "1"})
    page = door.page
    headers = {
        "Content-Security-Policy": VIEWER_POLICY,
        "Cache-Control": "no-cache",
        "ETag": page.tag,
        "Vary": "Accept-Encoding",
    }
    if has_already(request.headers, page.tag):
        return Response(None, 304, headers)
    if takes_gzip(request.headers):
        return HTMLResponse(page.compressed, headers={**headers, "Content-Encoding": "gzip"})
    return HTMLResponse(page.plain, headers=headers)


@router.websocket("/viewer")
@router.websocket("/viewer/{key}")
async def viewer_socket(socket: WebSocket, door: Door) -> None:
    """Carries viser's messages to the browser, and the browser's camera to viser."""
    viewer = door.viewer
    if viewer.port is None:
        await socket.send_denial_response(SafeJSON({"detail": viewer.trouble}, 503))
        return
    wanted = [Subprotocol(p) for p in socket.scope["subprotocols"] if len(p) < _LONGEST_SUBPROTOCOL]
    try:
        upstream = await connect(
            f"ws://127.0.0.1:{viewer.port}/",
            subprotocols=wanted or None,
            additional_headers=viewer.headers,
            compression=None,
            # Slow browsers must slow viser down here, not fill a queue.
            max_queue=1,
            max_size=None,
            ping_interval=None,
            open_timeout=_OPEN_TIMEOUT_S,
            proxy=None,
        )
    except (OSError, TimeoutError, InvalidHandshake) as error:
        log.warning("viewer_not_reached", reason=str(error))
        await socket.send_denial_response(SafeJSON({"detail": "the 3D viewer is unavailable"}, 503))
        return
    async with upstream:
        await socket.accept(subprotocol=upstream.subprotocol)
        with viewer.connected():
            await until_one_ends(socket, _down(upstream, socket), _up(socket, upstream))
        code = upstream.close_code
        if code is not None:
            await close(
                socket, GOING_AWAY if code in _NEVER_SENT else code, upstream.close_reason or ""
            )


async def _down(upstream: ClientConnection, socket: WebSocket) -> None:
    try:
        while True:
            message = await upstream.recv(decode=False)
            await socket.send_bytes(message)
    except ConnectionClosed:
        return


async def _up(socket: WebSocket, upstream: ClientConnection) -> None:
    while True:
        message = await socket.receive()
        if message["type"] == "websocket.disconnect":
            raise WebSocketDisconnect(message.get("code", 1005))
        data = message.get("bytes")
        if not isinstance(data, bytes):
            raise BadMessage("the viewer accepts only binary messages")
        if passes(data):
            try:
                await upstream.send(data)
            except ConnectionClosed:
                return
            # Throttle only the client that sends too much, not everyone.
            await asyncio.sleep(_CAMERA_GAP_S)


def passes(data: bytes) -> bool:
    """Return whether a browser's message goes on to viser: only a complete, valid camera pose does.

    Raises:
        BadMessage: it is not a message of viser's client.
    """
    try:
        kind = _kind.decode(data).type
    except (msgspec.DecodeError, RecursionError):
        raise BadMessage("invalid viewer message") from None
    if kind != "ViewerCameraMessage":
        log.debug("viewer_message_dropped", kind=kind[:50])
        return False
    try:
        _camera.decode(data)
    except (msgspec.DecodeError, RecursionError):
        raise BadMessage("invalid camera pose") from None
    return True
