"""Clients that have not signed in must not block the server for those that have."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import time
from collections.abc import Iterator
from typing import Any

import pytest

from app.http.gate.strangers import Strangers

from ..clock import Clock

HALF_A_HEAD = b"GET / HTTP/1.1\r\nX: "
UNKNOWN = b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"


@contextlib.contextmanager
def pairs(count: int) -> Iterator[list[tuple[socket.socket, socket.socket]]]:
    made = [socket.socketpair() for _ in range(count)]
    try:
        yield made
    finally:
        for pair in made:
            for end in pair:
                end.close()


def is_ended(end: socket.socket) -> bool:
    end.settimeout(0.05)
    try:
        return end.recv(1) == b""
    except TimeoutError:
        return False


def test_the_oldest_connection_of_the_busiest_address_is_dropped() -> None:
    strangers = Strangers(Clock(), most=3)
    with pairs(3) as made:
        addresses = ["10.0.0.1", "10.0.0.2", "10.0.0.2"]
        for (mine, _), address in zip(made, addresses, strict=True):
            assert strangers.make_room()
            strangers.come(mine, address)
        assert not strangers.make_room()
        assert [is_ended(other) for _, other in made] == [False, True, False]
        assert strangers.make_room()


def test_a_client_served_or_signed_in_does_not_count() -> None:
    clock = Clock()
    strangers = Strangers(clock, most=1, within_s=5.0)
    with pairs(2) as made:
        mine, theirs = made[0]
        strangers.come(mine, "10.0.0.1")
        strangers.asked(mine.fileno())
        assert strangers.make_room()
        clock.now += 60.0
        strangers.sweep()
        assert not is_ended(theirs)
        strangers.answered(mine.fileno(), signed_in=True)
        assert strangers.count == 0
        # A client answered without signing in waits again, from then on.
        mine, theirs = made[1]
        strangers.come(mine, "10.0.0.1")
        strangers.asked(mine.fileno())
        strangers.answered(mine.fileno(), signed_in=False)
        clock.now += 4.0
        strangers.sweep()
        assert strangers.count == 1
        clock.now += 2.0
        strangers.sweep()
        assert is_ended(theirs)


def test_closed_connections_leave_no_trace() -> None:
    strangers = Strangers(Clock(), most=2)
    for _ in range(10):
        with pairs(1) as made:
            strangers.come(made[0][0], "10.0.0.1")
            assert strangers.make_room()
    assert strangers.count == 0


@pytest.mark.parametrize("said", [b"", HALF_A_HEAD, UNKNOWN])
async def test_a_flood_of_strangers_does_not_block_stop(served: Any, said: bytes) -> None:
    held: list[asyncio.StreamWriter] = []
    try:
        for _ in range(400):
            _, writer = await asyncio.open_connection("127.0.0.1", served.port)
            writer.write(said)
            held.append(writer)
        for _ in range(5):
            started = time.monotonic()
            # On a connection of its own, opened after all others.
            async with served.anonymous(Authorization=served.http.headers["Authorization"]) as late:
                answer = await late.post("/api/robots/stop")
            assert answer.status_code == 200
            assert time.monotonic() - started < 4.0
        assert served.strangers.count <= 101
    finally:
        for writer in held:
            writer.close()


async def test_an_open_socket_survives_a_flood(served: Any) -> None:
    async with served.socket("/api/live") as live:
        held = [await asyncio.open_connection("127.0.0.1", served.port) for _ in range(300)]
        try:
            async with asyncio.timeout(5.0):
                for _ in range(3):
                    await live.recv()
        finally:
            for _, writer in held:
                writer.close()
