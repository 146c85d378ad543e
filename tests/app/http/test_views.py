"""Live images: only the newest, drawn only while someone watches."""

from __future__ import annotations

import asyncio
import struct
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from app.contract.views import VIEW_NAMES

from .wire import read_on


async def image(socket: Any) -> tuple[int, float, bytes]:
    data = await socket.recv()
    sequence, age_ms = struct.unpack(">Qd", data[:16])
    return sequence, age_ms, data[16:]


async def test_images_are_sent_as_they_are_acknowledged(
    served: Any, peer: Any, eventually: Any
) -> None:
    async with served.socket("/api/views/left") as socket:
        first, age_ms, jpeg = await image(socket)
        assert peer.watched == ("left",)
        assert jpeg.startswith(b"\xff\xd8")
        assert 0 <= age_ms < 5000
        for _ in range(10):
            peer.observe()
            await asyncio.sleep(0.01)
        # Nothing comes before the acknowledgement, then only the newest image.
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.2):
                await socket.recv()
        await socket.send("ack")
        newest, _, _ = await image(socket)
        assert newest == first + 10
    await eventually(lambda: peer.watched == ())


async def test_only_watched_views_are_drawn(served: Any, peer: Any, eventually: Any) -> None:
    assert peer.watched == ()
    async with served.socket("/api/views/left") as one, served.socket("/api/views/left") as two:
        await image(one)
        # The second watcher gets the existing image, even if nothing new is drawn.
        await image(two)
        async with served.socket("/api/views/disparity") as three:
            await image(three)
            assert peer.watched == ("disparity", "left")
        await eventually(lambda: peer.watched == ("left",))
        await one.close()
        peer.observe()
        await two.send("ack")
        assert await image(two)
        assert peer.watched == ("left",)


async def test_a_new_engine_gets_the_watched_views(served: Any, peer: Any, eventually: Any) -> None:
    async with served.socket("/api/views/left") as socket:
        await image(socket)
        peer.lose()
        peer.watched = ()
        peer.start_process()
        await eventually(lambda: peer.watched == ("left",))
        await socket.send("ack")
        assert await image(socket)


async def test_snapshots_are_served_while_current(http: Any, peer: Any, eventually: Any) -> None:
    names = (await http.get("/api/views")).json()
    assert names == list(VIEW_NAMES)
    for name in names:
        answer = await http.get(f"/api/views/{name}.jpg")
        assert answer.headers["content-type"] == "image/jpeg"
        assert answer.content.startswith(b"\xff\xd8")
    await eventually(lambda: peer.watched == ())
    assert (await http.get("/api/views/none.jpg")).status_code == 404
    peer.draw_on_watch = False
    # An old image is not shown as a current one.
    assert (await http.get("/api/views/left.jpg")).status_code == 503


async def test_unknown_views_and_garbage_are_refused(served: Any) -> None:
    for name in ("none", "cloud", "..", "left.jpg"):
        with pytest.raises(InvalidStatus) as refused:
            async with served.socket(f"/api/views/{name}"):
                pass
        assert refused.value.response.status_code in (403, 404)
    for garbage in ("nack", b"ack"):
        async with served.socket("/api/views/left") as socket:
            await socket.send(garbage)
            with pytest.raises(ConnectionClosed):
                await read_on(socket)
            assert socket.close_code == 1007
    assert (await served.http.get("/api/status")).is_success
