"""A run ends even if that cannot be written; it is written once there is room."""

from __future__ import annotations

import asyncio
from functools import partial
from typing import Any

import pytest

from app.server.background import Background
from app.server.runs.ending import write_end
from app.server.writer import Writer
from app.storage import RunRecord, RunState, Storage, StorageFull, StorageMissing


async def test_a_run_end_is_written_once_there_is_room(
    storage: Storage, monkeypatch: pytest.MonkeyPatch
) -> None:
    storage.open()
    record = storage.create_run(name="a", source="b", parameters={}, versions={})
    update, refusals = storage.update_run, [3]

    def full(run_id: str, **changes: Any) -> RunRecord:
        if refusals[0]:
            refusals[0] -= 1
            raise StorageFull("no space is left")
        return update(run_id, **changes)

    monkeypatch.setattr(storage, "update_run", full)
    writer = Writer()

    writer.start()
    try:
        background = Background()
        write = partial(storage.update_run, record.id, state=RunState.FINISHED)
        written = await write_end(writer, write, record.id, background.start, again_s=0.01)
        assert written is None
        while background._tasks:
            await asyncio.sleep(0.01)
    finally:
        writer.stop()
    found = storage.get_run(record.id)
    assert found is not None
    assert (refusals[0], found.state) == (0, RunState.FINISHED)


async def test_an_error_other_than_a_full_disk_is_not_retried() -> None:
    tries: list[str] = []

    def missing() -> RunRecord:
        tries.append("once")
        raise StorageMissing("there is no such run")

    writer = Writer()
    background = Background()
    writer.start()
    try:
        assert await write_end(writer, missing, "r", background.start) is None
    finally:
        writer.stop()
    assert (tries, background._tasks) == (["once"], set())
