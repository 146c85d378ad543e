"""What goes into the database of a run that is kept."""

from __future__ import annotations

import threading
from typing import Any

import pytest

from app.station.current_run import CurrentRun
from app.station.driving.wheels import WheelSample
from app.station.writer import Writer
from app.storage import Storage, StorageBusy


def test_rows_are_written_once_although_the_database_was_locked(
    storage: Storage, monkeypatch: pytest.MonkeyPatch
) -> None:
    storage.open()
    record = storage.create_run(name="a", source="b", parameters={}, versions={})
    update, locked, written = storage.update_run, [True], threading.Event()

    def locked_once(run_id: str, **changes: Any) -> None:
        if locked:
            locked.clear()
            raise StorageBusy("the database is busy")
        update(run_id, **changes)
        written.set()

    monkeypatch.setattr(storage, "update_run", locked_once)
    writer = Writer()
    writer.start()
    try:
        run = CurrentRun(record, storage, writer, lambda: 0.0)
        run.measured(WheelSample(1, "observer", 1.0, 0, 0.3, 0.25))
        run.flush()
        assert written.wait(5.0)
    finally:
        writer.stop()
    assert [row.speed for row in storage.speeds(record.id)] == [0.3, 0.25]
    assert writer.dropped == 0
