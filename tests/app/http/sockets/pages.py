"""Pages that drive over the socket."""

from __future__ import annotations

import asyncio
import contextlib
import json
import threading
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

# A page's clock starts when the page is opened.
EPOCH = time.monotonic() - 12.0


def clock_ms() -> float:
    return 1000 * (time.monotonic() - EPOCH)


class Hand:
    """A page: answers pings, keeps what it receives, sends commands."""

    def __init__(self, socket: Any) -> None:
        self.socket = socket
        self.heard: list[dict[str, Any]] = []
        self.sequence = 0
        self._news = asyncio.Condition()

    async def listen(self) -> None:
        with contextlib.suppress(ConnectionClosed):
            while True:
                message = json.loads(await self.socket.recv())
                if message["type"] == "ping":
                    await self.say({"type": "pong", "id": message["id"], "time": clock_ms()})
                async with self._news:
                    self.heard.append(message)
                    self._news.notify_all()

    async def say(self, message: dict[str, Any] | str) -> None:
        await self.socket.send(message if isinstance(message, str) else json.dumps(message))

    async def next(self, kind: str, **fields: Any) -> dict[str, Any]:
        """Return the next message of a kind (with these fields) that was not taken yet."""
        async with asyncio.timeout(10), self._news:
            while True:
                for message in self.heard:
                    if message["type"] == kind and fields.items() <= message.items():
                        self.heard.remove(message)
                        return message
                await self._news.wait()

    async def take(self, role: str = "observer", *, takeover: bool = False) -> dict[str, Any]:
        await self.say({"type": "take", "role": role, "takeover": takeover})
        return await self.next("lease", role=role)

    async def drive(self, *, role: str = "observer", ago_ms: float = 0.0, **more: Any) -> int:
        self.sequence += 1
        message = {
            "type": "drive",
            "role": role,
            "sequence": self.sequence,
            "time": clock_ms() - ago_ms,
            "speed_mps": 0.2,
            "turn_rate_radps": 0.1,
        }
        await self.say({**message, **more})
        return self.sequence


@asynccontextmanager
async def hand(served: Any, name: str | None = None) -> AsyncIterator[Hand]:
    path = "/api/drive" if name is None else f"/api/drive?name={name}"
    async with served.socket(path) as socket:
        page = Hand(socket)
        listening = asyncio.create_task(page.listen())
        try:
            await page.next("link", quality="good")
            yield page
        finally:
            listening.cancel()
            await asyncio.gather(listening, return_exceptions=True)


async def arm(served: Any, lease: str | None, role: str = "observer") -> int:
    answer = await served.http.post(f"/api/robots/{role}/arm", json={"lease": lease})
    return int(answer.status_code)


class Elsewhere(threading.Thread):
    """A page that keeps sending commands, whatever the server's event loop does.

    Attributes:
        speed_mps: speed of its commands; None: it is only present.
    """

    def __init__(self, port: int, token: str, role: str = "observer") -> None:
        super().__init__(name="a page")
        self.role = role
        self.speed_mps: float | None = 0.2
        self._url = f"ws://127.0.0.1:{port}/api/drive"
        self._headers = {"Authorization": f"Bearer {token}"}
        self.started = threading.Event()
        self.done = threading.Event()
        self.given: dict[int, float] = {}
        self.heard: list[dict[str, Any]] = []

    def run(self) -> None:
        with connect(
            self._url, additional_headers=self._headers, compression=None, proxy=None
        ) as socket:
            socket.send(json.dumps({"type": "take", "role": self.role}))
            sequence, due = 0, time.monotonic() + 0.6
            while not self.done.is_set():
                for message in self._messages(socket, due):
                    if message["type"] == "ping":
                        pong = {"type": "pong", "id": message["id"], "time": clock_ms()}
                        socket.send(json.dumps(pong))
                    self.heard.append(message)
                due, sequence = due + 0.1, sequence + 1
                self.given[sequence] = time.monotonic()
                command = {"role": self.role, "sequence": sequence, "time": clock_ms()}
                moves = {"speed_mps": self.speed_mps, "turn_rate_radps": 0.0}
                if self.speed_mps is None:
                    socket.send(json.dumps({"type": "present", **command}))
                else:
                    socket.send(json.dumps({"type": "drive", **command, **moves}))
                if sequence > 5:
                    self.started.set()

    @property
    def lease(self) -> str | None:
        """Return its lease, None until it has one."""
        return next((m["lease"] for m in self.heard if m["type"] == "lease"), None)

    @staticmethod
    def _messages(socket: Any, until: float) -> Iterator[dict[str, Any]]:
        while (left := until - time.monotonic()) > 0:
            try:
                yield json.loads(socket.recv(timeout=left))
            except TimeoutError:
                return
