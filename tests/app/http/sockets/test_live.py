"""The live socket: what a page receives, and what a slow one costs."""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from functools import partial
from typing import Any

import psutil
import pytest
from starlette.websockets import WebSocketState
from websockets.exceptions import ConnectionClosed

from app.http.sockets.live import LiveHub
from app.server.journal import Journal

from ..wire import read_on


async def next_of(socket: Any, kind: str) -> dict[str, Any]:
    """The next message of a kind."""
    while True:
        message: dict[str, Any] = json.loads(await socket.recv())
        if message["type"] == kind:
            return message


async def heard_for(socket: Any, seconds: float) -> list[dict[str, Any]]:
    messages: list[dict[str, Any]] = []
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(seconds):
            while True:
                messages.append(json.loads(await socket.recv()))
    return messages


async def painted(socket: Any, sequence: int) -> None:
    await socket.send(json.dumps({"type": "painted", "sequence": sequence}))


async def test_a_page_receives_status_heartbeats_and_observations(served: Any, peer: Any) -> None:
    async with served.socket("/api/live") as socket:
        status = await next_of(socket, "status")
        rest = (await served.http.get("/api/status")).json()
        assert set(status) == set(rest) | {"type"}
        beat = await next_of(socket, "heartbeat")
        assert beat["observation_age_s"] is None
        event = peer.observe()
        seen = await next_of(socket, "observation")
        assert seen["line"] == event.line
        assert seen["truth"] == event.truth
        assert 0 <= seen["age_ms"] < 5000
        beat = await next_of(socket, "heartbeat")
        assert 0 <= beat["observation_age_s"] < 5


async def test_a_late_page_gets_only_the_current_observation(served: Any, peer: Any) -> None:
    peer.observe()
    async with served.socket("/api/live") as socket:
        seen = await next_of(socket, "observation")
        assert seen["line"]["frame"] == 0
    # Observations of another source are no longer valid.
    await served.http.put("/api/source", json={"source": "another"})
    async with served.socket("/api/live") as socket:
        kinds = {message["type"] for message in await heard_for(socket, 0.5)}
        assert kinds == {"status", "robots", "heartbeat"}


async def test_twenty_slow_pages_use_little_memory_and_slow_no_other_page(
    served: Any, peer: Any
) -> None:
    async with contextlib.AsyncExitStack() as stack:
        slow = []
        for path in 10 * ["/api/live"] + 10 * ["/api/views/left"]:
            slow.append(await stack.enter_async_context(served.socket(path)))
            slow[-1].transport.pause_reading()
        quick = await stack.enter_async_context(served.socket("/api/live"))
        before = psutil.Process().memory_info().rss
        for _ in range(300):
            peer.padding = "x" * 50_000
            event = peer.observe()
            seen = await next_of(quick, "observation")
            assert seen["line"]["frame"] == event.line["frame"]
            await painted(quick, seen["sequence"])
        assert psutil.Process().memory_info().rss - before < 50 * 1024**2
        for socket in slow:
            socket.transport.abort()


async def test_heartbeats_and_status_are_sent_while_idle(served: Any) -> None:
    async with served.socket("/api/live") as socket:
        messages = await heard_for(socket, 2.0)
        kinds = [message["type"] for message in messages]
        # A heartbeat every 250 ms and a status twice a second are promised.
        assert kinds.count("heartbeat") >= 6
        assert kinds.count("status") >= 3


async def test_a_change_is_sent_immediately(served: Any, peer: Any) -> None:
    async with served.socket("/api/live") as socket:
        await next_of(socket, "status")
        peer.lose("the engine ended with exit code 1")
        for _ in range(5):
            status = await next_of(socket, "status")
            if status["engine"]["state"] == "failed":
                break
        assert "exit code 1" in status["engine"]["reason"]
        peer.start_process()
        while status["engine"]["state"] != "preview":
            status = await next_of(socket, "status")
        assert status["engine"]["restarts"] == 1
        assert status["engine"]["generation"] == 2


async def test_latency_ends_with_the_acknowledgement(served: Any, peer: Any) -> None:
    async with served.socket("/api/live") as socket:
        await next_of(socket, "status")
        peer.observe()
        seen = await next_of(socket, "observation")
        await asyncio.sleep(0.2)
        await painted(socket, seen["sequence"])
        # A repeated or unknown sequence number is not a measurement.
        await painted(socket, seen["sequence"])
        await painted(socket, 10**9)
        while True:
            latency = (await next_of(socket, "status"))["latency_ms"]
            if latency["count"]:
                break
        assert latency["count"] == 1
        assert 200 <= latency["median"] < 5000
        assert latency["p95"] == latency["median"]


async def test_a_page_without_acks_gets_two_messages_and_then_the_newest(
    served: Any, peer: Any
) -> None:
    async with served.socket("/api/live") as socket:
        await next_of(socket, "status")
        got = []
        for _ in range(2):
            peer.observe()
            got.append(await next_of(socket, "observation"))
        for _ in range(30):
            peer.observe()
        messages = await heard_for(socket, 0.6)
        assert not [m for m in messages if m["type"] == "observation"]
        await painted(socket, got[0]["sequence"])
        newest = await next_of(socket, "observation")
        assert newest["line"]["frame"] == 31
        drops = (await served.http.get("/api/status")).json()["drops"]
        assert drops["live_messages_dropped"] == 29


async def test_a_slow_page_does_not_affect_others(served: Any, peer: Any) -> None:
    async with served.socket("/api/live"), served.socket("/api/live") as quick:
        await next_of(quick, "status")
        for frame in range(40):
            peer.observe()
            seen = await next_of(quick, "observation")
            assert seen["line"]["frame"] == frame
            await painted(quick, seen["sequence"])
        assert served.server.viewers == 2


async def test_pages_are_counted(served: Any, eventually: Any) -> None:
    async with served.socket("/api/live") as socket:
        assert (await next_of(socket, "status"))["viewers"] == 1
    await eventually(lambda: served.server.viewers == 0)


GARBAGE: tuple[str | bytes, ...] = (
    "",
    "hello",
    "[1, 2]",
    '{"type": "painted"}',
    '{"type": "painted", "sequence": true}',
    '{"type": "painted", "sequence": "1"}',
    '{"type": "painted", "sequence": 1.5}',
    '{"type": "other"}',
    "[" * 900,
    "x" * 10_000,
    b"\x00\xff\xfe",
)


async def test_garbage_closes_only_its_own_page_with_1007(served: Any) -> None:
    async with served.socket("/api/live") as other:
        for garbage in GARBAGE:
            async with served.socket("/api/live") as socket:
                await socket.send(garbage)
                with pytest.raises(ConnectionClosed):
                    await read_on(socket)
                assert socket.close_code == 1007, garbage
        last = served.server.clock()
        while (await next_of(other, "heartbeat"))["time"] < last:
            pass


async def test_invalid_utf8_closes_with_1007(served: Any) -> None:
    async with served.socket("/api/live") as socket:
        await socket.send(b"\xff\xfe\xfd", text=True)
        with pytest.raises(ConnectionClosed):
            await read_on(socket)
        assert socket.close_code == 1007
        assert (await served.http.get("/api/status")).is_success


async def test_garbage_ends_a_page_even_at_the_moment_a_message_is_due(
    served: Any, peer: Any
) -> None:
    """A wait cancelled just as it ends must still be cancelled, or the page would never close."""

    async def closed(served: Any, later: int) -> None:
        hub, socket = LiveHub(served.server, Journal(served.server)), _ScriptedSocket()
        page = asyncio.ensure_future(hub.serve(socket))  # type: ignore[arg-type]
        while len(socket.sent) < 3:
            await asyncio.sleep(0.01)
        steps = [partial(hub.observed, peer.observe()), partial(socket.say, "hello")]
        first, second = steps if later > 0 else reversed(steps)
        first()
        for _ in range(abs(later)):
            await asyncio.sleep(0)
        second()
        async with asyncio.timeout(5):
            await page
        assert socket.closed == 1007

    for later in range(-6, 7):
        await closed(served, later)


async def test_the_server_shuts_down_while_pages_are_open(serve: Any) -> None:
    async with serve() as served:
        socket = await served.socket("/api/live")
        await next_of(socket, "status")
        started = time.monotonic()
    assert time.monotonic() - started < 5
    with pytest.raises(ConnectionClosed):
        await read_on(socket)
    assert socket.close_code == 1012


class _ScriptedSocket:
    """A page's socket that sends what it is told to, in the same turn of the loop."""

    application_state = client_state = WebSocketState.CONNECTED

    def __init__(self) -> None:
        self.sent: list[str] = []
        self.closed: int | None = None
        self._said: asyncio.Future[dict[str, str]] = asyncio.get_running_loop().create_future()

    def say(self, text: str) -> None:
        self._said.set_result({"type": "websocket.receive", "text": text})

    async def receive(self) -> dict[str, str]:
        return await self._said

    async def send_text(self, text: str) -> None:
        self.sent.append(text)

    async def close(self, code: int, _: str) -> None:
        self.closed = code
