"""Driving over the socket: commands that are refused, and misbehaving clients."""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed

from app.contract.drive import DriveCommand

from .pages import Elsewhere, Hand, arm, clock_ms, hand

pytestmark = pytest.mark.usefixtures("world")


async def test_old_or_repeated_commands_are_refused(
    served: Any, drive: Any, eventually: Any
) -> None:
    await eventually(lambda: len(drive.robots) == 2)
    async with hand(served) as page:
        lease = (await page.take())["lease"]
        assert await arm(served, lease) == 200
        late = await page.drive(ago_ms=400)
        refused = await page.next("refused", sequence=late)
        assert refused["sentence"] == "stopped: connection too slow"
        slow = await page.next("link", quality="slow")
        assert slow["sentence"] == "stopped: connection too slow"
        assert slow["delay_ms"] > 250
        good = await page.drive()
        await page.next("sent", sequence=good)
        for sequence in (good, good - 1, 0):
            await page.drive(sequence=sequence)
            refused = await page.next("refused", sequence=sequence)
            assert "sequence must be greater than" in refused["sentence"]
        # A timestamp in the future does not make a command fresh.
        await page.drive(ago_ms=-5000, sequence=good + 50)
        assert "delay is unknown" in (await page.next("refused", sequence=good + 50))["sentence"]
        assert [command.sequence for command in drive.of(DriveCommand)] == [good]


async def test_commands_are_refused_before_the_link_is_measured(served: Any, drive: Any) -> None:
    async with served.socket("/api/drive") as socket:
        page = Hand(socket)
        await page.say({"type": "take", "role": "observer"})
        await page.drive()
        while (message := json.loads(await socket.recv()))["type"] != "refused":
            pass
        assert "delay is unknown" in message["sentence"] or "take" in message["sentence"]
        assert not drive.of(DriveCommand)


async def test_non_numeric_values_are_refused_and_the_socket_stays_open(
    served: Any, drive: Any
) -> None:
    async with hand(served) as page:
        await page.take()
        fields = {"role": "observer", "sequence": 1, "time": clock_ms()}
        body = {"type": "drive", **fields, "speed_mps": 0.1, "turn_rate_radps": 0}
        for key in ("time", "speed_mps", "turn_rate_radps", "sequence"):
            for value in ("NaN", "Infinity", "1e999", "true", "null", '"0.1"'):
                text = json.dumps({**body, key: "HERE"}).replace('"HERE"', value)
                await page.say(text)
                assert key in (await page.next("refused"))["sentence"]
            await page.say({name: value for name, value in body.items() if name != key})
            assert key in (await page.next("refused"))["sentence"]
        assert not drive.of(DriveCommand)
        await page.next("sent", sequence=await page.drive())


async def test_garbage_closes_with_1007_and_releases_the_lease(
    served: Any, drive: Any, eventually: Any
) -> None:
    for garbage in ("hello", "[1]", '{"type": "fly"}', "[" * 900, b"\x00\xff"):
        async with hand(served) as page:
            assert (await page.take())["state"] == "yours"
            await page.socket.send(garbage)
            await eventually(lambda: page.socket.close_code is not None)
            assert page.socket.close_code == 1007
        await eventually(lambda: not drive.leases)


async def test_excess_commands_are_refused_and_not_queued(served: Any, drive: Any) -> None:
    async with hand(served) as page:
        await page.take()
        drive.hangs = True
        sequences = [await page.drive() for _ in range(12)]
        refused = await page.next("refused", sequence=sequences[-1])
        assert "is overloaded" in refused["sentence"]
        await page.next("refused", sequence=sequences[0])
        drive.hangs = False
        await page.next("sent", sequence=await page.drive())
        passed_on = [command.sequence for command in drive.of(DriveCommand)]
        assert passed_on == [*sequences[:8], sequences[-1] + 1]


async def test_a_client_that_stops_reading_is_dropped(
    served: Any, drive: Any, eventually: Any
) -> None:
    async with served.socket("/api/drive") as socket:
        page = Hand(socket)
        await page.say({"type": "take", "role": "observer"})
        await eventually(lambda: drive.leases)
        socket.transport.pause_reading()
        with contextlib.suppress(ConnectionClosed):
            # The answers must exceed the socket buffers of both ends.
            async with asyncio.timeout(20):
                while drive.leases:
                    await page.say('{"type": "present", "role": "observer"}')
        assert not drive.leases
        socket.transport.abort()


async def test_commands_queued_during_a_stall_are_refused(
    served: Any, drive: Any, eventually: Any, token: str
) -> None:
    """Two seconds of commands wait in the kernel; their age is known when they are read."""

    page = Elsewhere(served.port, token)
    page.start()
    try:
        await eventually(page.started.is_set)
        stood_from = time.monotonic()
        time.sleep(2.0)
        stood_until = time.monotonic()
        await asyncio.sleep(1.0)
    finally:
        page.done.set()
        await asyncio.to_thread(page.join)
    refused = {m["sequence"] for m in page.heard if m["type"] == "refused"}
    waited = [
        sequence
        for sequence, given in page.given.items()
        if stood_from + 0.05 < given < stood_until - 0.25
    ]
    assert len(waited) > 10
    assert set(waited) <= refused
    for command in drive.of(DriveCommand):
        given = page.given[command.sequence]
        # Never rated fresher than it is, within the uncertainty of the clocks.
        assert command.issued <= given + 0.02
    # The link recovers by itself.
    assert max(c.sequence for c in drive.of(DriveCommand)) > max(waited)
