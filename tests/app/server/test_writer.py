"""Writing to the database, even when it does not respond."""

from __future__ import annotations

import asyncio
import sqlite3
import time
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from structlog.testing import capture_logs

from app.server import Server
from app.server.status import status
from app.server.writer import Writer
from app.storage import RunState, Storage, StorageBusy, StorageError, StorageFull

from ...waiting import until, until_async
from .servers import begin


async def test_a_locked_database_blocks_nothing(
    peer: Any, storage: Storage, tmp_path: Path, server: Server
) -> None:
    record = await begin(server)
    with_lock = sqlite3.connect(tmp_path / "observer.sqlite", isolation_level=None)
    with_lock.execute("BEGIN IMMEDIATE")
    try:
        longest = 0.0
        for _ in range(60):
            before = time.monotonic()
            peer.observe()
            await asyncio.sleep(0.02)
            longest = max(longest, time.monotonic() - before)
        # The loop never waited for the lock (its timeout is half a second).
        assert longest < 0.4
        await until_async(lambda: status(server).warnings)
        with pytest.raises(StorageBusy):
            await server.parameters.save_preset("x", "")
        # Stopping works, whatever the database does.
        ended = await server.runs.stop(record.id)
        assert ended.state is RunState.FINISHED
    finally:
        with_lock.execute("ROLLBACK")
        with_lock.close()
    await until_async(lambda: not status(server).warnings)
    await until_async(lambda: storage.get_run(record.id).state is RunState.FINISHED)
    assert storage.get_run(record.id).frames == 60
    assert len(storage.speeds(record.id)) == 180
    assert server.shared.writer.dropped == 0


def test_the_writers_queue_is_bounded() -> None:
    def busy() -> None:
        raise StorageBusy("locked")

    writer = Writer(queue_length=5, patience_s=60)
    writer.start()
    posted = [writer.post(busy) for _ in range(20)]
    assert posted.count(False) >= 14
    assert writer.dropped == posted.count(False)
    until(lambda: writer.trouble == "locked")
    started = time.monotonic()
    writer.stop()
    assert time.monotonic() - started < 5


async def test_a_failing_write_ends_neither_the_thread_nor_the_next_write() -> None:
    def full() -> None:
        raise StorageError("no space")

    def broken() -> None:
        raise ZeroDivisionError

    writer = Writer()
    writer.start()
    try:
        with pytest.raises(StorageError):
            await writer.submit(full)
        assert writer.trouble == "no space"
        with pytest.raises(ZeroDivisionError):
            await writer.submit(broken)
        assert await writer.submit(lambda: 5) == 5
        assert writer.trouble is None
    finally:
        await asyncio.to_thread(writer.stop)


async def test_changes_on_a_full_disk_are_told_and_stored_once_it_has_room() -> None:
    stored: list[int] = []
    room = False

    def change(number: int) -> None:
        if not room:
            raise StorageFull("no space is left")
        stored.append(number)

    writer = Writer(again_s=0.05)
    writer.start()
    try:
        for number in range(3):
            assert writer.post(partial(change, number))
        await until_async(lambda: "3 changes" in str(writer.trouble))
        # Another write that fits changes neither the sentence nor the order.
        assert await writer.submit(lambda: 5) == 5
        assert "3 changes" in str(writer.trouble)
        with capture_logs() as logs:
            await asyncio.sleep(0.2)
        assert not logs
        room = True
        await until_async(lambda: writer.trouble is None)
        assert writer.post(partial(change, 3))
        await until_async(lambda: len(stored) == 4)
    finally:
        await asyncio.to_thread(writer.stop)
    assert stored == [0, 1, 2, 3]
    assert writer.dropped == 0


async def test_changes_that_never_fit_are_counted_at_the_end() -> None:
    def full() -> None:
        raise StorageFull("no space is left")

    refused = 0

    def post() -> bool:
        nonlocal refused
        is_taken = writer.post(full)
        refused += not is_taken
        return is_taken

    writer = Writer(queue_length=4)
    writer.start()
    for _ in range(6):
        await until_async(post)
    await asyncio.to_thread(writer.stop)
    assert writer.dropped == 6 + refused
