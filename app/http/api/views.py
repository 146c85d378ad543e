"""Live views as images: a WebSocket for watching, a snapshot for scripts."""

from __future__ import annotations

import asyncio
import struct
from typing import Annotated

from fastapi import APIRouter, Path, Response, WebSocket

from app.contract.views import VIEW_NAMES
from app.http.api.common import Feeds, TheServer
from app.http.api.refusals import refusals
from app.http.errors import SafeJSON
from app.http.sockets.budget import Budget
from app.http.sockets.connections import BadMessage, receive_text, until_one_ends
from app.server import NotAvailable, NotThere

router = APIRouter(tags=["views"])

# Sequence, then age at sending in ms, both big-endian.
_HEADER = struct.Struct(">Qd")
_SNAPSHOT_TIMEOUT_S = 3.0
_NO_SUCH_VIEW = f"available views are {', '.join(VIEW_NAMES)}"

ViewName = Annotated[str, Path(max_length=50)]


@router.get("/views", summary="Names of the live views")
async def get_views() -> list[str]:
    """Each is a JPEG at ``/api/views/NAME.jpg`` and a WebSocket at ``/api/views/NAME``."""
    return list(VIEW_NAMES)


@router.get(
    "/views/{name}.jpg",
    summary="The newest image of a view",
    response_class=Response,
    responses={200: {"content": {"image/jpeg": {}}}, **refusals(404, 503)},
)
async def get_snapshot(name: ViewName, feeds: Feeds) -> Response:
    """Drawn for this request; while paused, it shows the current frame."""
    if name not in feeds:
        raise NotThere(_NO_SUCH_VIEW)
    async with feeds[name].watched():
        try:
            async with asyncio.timeout(_SNAPSHOT_TIMEOUT_S):
                newest = await feeds[name].newer(0)
        except TimeoutError:
            raise NotAvailable(
                f"there is no image of the view {name} yet; open a source first"
            ) from None
    return Response(newest.payload, media_type="image/jpeg")


@router.websocket("/views/{name}")
async def watch_view(socket: WebSocket, name: ViewName, feeds: Feeds, server: TheServer) -> None:
    """Sends the newest image, and the next one only after the client's ``ack``.

    A slow client gets fewer images, never older ones; see ``app.http.sockets.budget``.
    """
    if name not in feeds:
        await socket.send_denial_response(SafeJSON({"detail": _NO_SUCH_VIEW}, 404))
        return
    await socket.accept()
    acknowledged = asyncio.Event()
    acknowledged.set()
    budget = Budget(server.clock)
    sent = server.clock()

    async def send() -> None:
        nonlocal sent
        sequence = 0
        while True:
            await acknowledged.wait()
            await asyncio.sleep(budget.wait_s)
            newest = await feeds[name].newer(sequence)
            sequence = newest.sequence
            acknowledged.clear()
            sent = server.clock()
            budget.sent()
            age_ms = 1000.0 * (sent - float(newest.header["received"]))
            await socket.send_bytes(_HEADER.pack(sequence, max(0.0, age_ms)) + newest.payload)

    async def read() -> None:
        while True:
            if await receive_text(socket) != "ack":
                raise BadMessage("acknowledge every image with the text ack")
            if not acknowledged.is_set():
                budget.acknowledged(server.clock() - sent)
            acknowledged.set()

    async with feeds[name].watched():
        await until_one_ends(socket, send(), read())
