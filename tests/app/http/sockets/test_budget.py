"""A lagging client has its rate halved, and halved again; it recovers once it keeps up."""

from __future__ import annotations

import asyncio
import json
from typing import Any

from app.http.sockets.budget import Budget


class Client:
    """A client that takes ``delay_s`` per message; there is a new one every 1/15 s."""

    def __init__(self) -> None:
        self.now = 100.0
        self.budget = Budget(lambda: self.now)
        self.delay_s = 0.05

    def take(self, seconds: float) -> float:
        """Receive messages for some time; return how many came per second."""
        end, taken = self.now + seconds, 0
        while self.now < end:
            self.now += self.budget.wait_s
            self.budget.sent()
            self.now += self.delay_s
            self.budget.acknowledged(self.delay_s)
            self.now = max(self.now, self.now + 1 / 15 - self.delay_s)
            taken += 1
        return taken / seconds


def test_a_client_that_keeps_up_is_not_throttled() -> None:
    client = Client()
    assert client.take(20.0) > 14.0
    assert client.budget.halvings == 0
    # A single slow message is not a lag.
    client.budget.acknowledged(3.0)
    assert client.budget.wait_s == 0.0


def test_a_lagging_client_has_its_rate_halved_and_restored() -> None:
    client = Client()
    client.delay_s = 0.5
    seen = [0]
    for _ in range(100):
        client.take(0.1)
        if client.budget.halvings != seen[-1]:
            seen.append(client.budget.halvings)
    assert seen == [0, 1, 2, 3]
    # At most three halvings, however long it lags.
    assert 0.15 < client.take(60.0) < 0.35
    assert client.budget.halvings == 3
    client.delay_s = 0.02
    client.take(25.0)
    assert client.budget.halvings == 0
    assert client.take(5.0) > 14.0


def test_a_pause_is_not_mistaken_for_a_slow_rate() -> None:
    client = Client()
    client.take(2.0)
    client.now += 3600.0
    client.budget.sent()
    for _ in range(9):
        client.budget.acknowledged(2.0)
    assert client.budget.wait_s < 4.0


async def observed(peer: Any, every_s: float) -> None:
    while True:
        peer.observe()
        await asyncio.sleep(every_s)


async def test_a_slow_page_is_throttled_over_a_real_port(served: Any, peer: Any) -> None:
    """It acknowledges after half a second, later at once; its messages are counted."""
    loop = asyncio.get_running_loop()
    came: list[float] = []
    delay_s = 0.5

    async with served.socket("/api/live") as socket:
        late: set[asyncio.Task[None]] = set()

        async def acknowledge(sequence: int) -> None:
            await asyncio.sleep(delay_s)
            await socket.send(json.dumps({"type": "painted", "sequence": sequence}))

        async def read() -> None:
            async for text in socket:
                message = json.loads(text)
                if message["type"] == "observation":
                    came.append(loop.time())
                    task = asyncio.create_task(acknowledge(message["sequence"]))
                    late.add(task)
                    task.add_done_callback(late.discard)

        def rate(seconds: float) -> float:
            return sum(each > loop.time() - seconds for each in came) / seconds

        reading = asyncio.create_task(read())
        frames = asyncio.create_task(observed(peer, 0.05))
        try:
            await asyncio.sleep(1.2)
            # Two messages are in flight at a time.
            own = len(came) / 1.2
            await asyncio.sleep(5.0)
            held = rate(3.0)
            assert held <= own / 2
            delay_s = 0.0
            await asyncio.sleep(5.0)
            assert rate(1.0) > 3 * own
        finally:
            for task in (reading, frames, *late):
                task.cancel()
            await asyncio.gather(reading, frames, *late, return_exceptions=True)
