"""Rows of a run while the database refuses them."""

from __future__ import annotations

import time
from collections.abc import Iterable
from functools import partial

import pytest

from app.server.robots.wheels import WheelSample
from app.server.runs.current_run import CurrentRun
from app.server.writer import Writer
from app.storage import RunRecord, RunState, SpeedRow, Storage, StorageBusy


class Locked:
    """A database that refuses speeds until it is told otherwise."""

    def __init__(self, storage: Storage, monkeypatch: pytest.MonkeyPatch) -> None:
        self.locked = True
        self.refused = 0
        self._append = storage.append_speeds
        monkeypatch.setattr(storage, "append_speeds", self._append_speeds)

    def _append_speeds(self, rows: Iterable[SpeedRow]) -> int:
        if self.locked:
            self.refused += 1
            raise StorageBusy("the database is locked")
        return self._append(rows)


def drive(run: CurrentRun, times: Iterable[int]) -> None:
    # Before a run's first frame, robot data have no source time.
    run.frames = 1
    for at in times:
        run.measured(WheelSample("observer", float(at), 0.01 * at, None, number=1, segment=0))
        run.flush()


def end(run: CurrentRun, writer: Writer) -> RunRecord:
    ended = run.ended(RunState.FINISHED, None)
    assert writer.post(partial(run.write_end, ended, None))
    writer.stop()
    return ended


@pytest.fixture
def record(storage: Storage) -> RunRecord:
    storage.open()
    return storage.create_run(name="a", source="b", parameters={}, versions={})


def test_no_row_is_lost_when_the_database_is_repeatedly_locked(
    storage: Storage, record: RunRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    lock = Locked(storage, monkeypatch)
    # Each write gives up at once, and the queue holds hardly more than the run's own rows.
    writer = Writer(queue_length=2, patience_s=0.0)
    writer.start()
    run = CurrentRun(record, storage, writer, lambda: 0.0)
    for begin in range(0, 100, 20):
        drive(run, range(begin, begin + 20))
        time.sleep(0.02)
    assert lock.refused >= 2
    lock.locked = False
    ended = end(run, writer)
    assert [row.time for row in storage.speeds(record.id)] == list(range(100))
    assert writer.dropped == 0
    kept = storage.get_run(record.id)
    assert kept is not None
    assert (kept.state, kept.reason, kept.ended_at) == (RunState.FINISHED, None, ended.ended_at)


def test_no_write_is_queued_during_a_retry(
    storage: Storage, record: RunRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    lock = Locked(storage, monkeypatch)
    writer = Writer(queue_length=1)
    writer.start()
    run = CurrentRun(record, storage, writer, lambda: 0.0)
    drive(run, range(300))
    lock.locked = False
    # The writer retries after a quarter of a second, and also takes the rows added meanwhile.
    deadline = time.monotonic() + 10
    while len(storage.speeds(record.id)) < 300 and time.monotonic() < deadline:
        # On a busy machine some are added after it looked: they are the next write.
        run.flush()
        time.sleep(0.02)
    assert len(storage.speeds(record.id)) == 300
    end(run, writer)
    assert writer.dropped == 0


def test_the_oldest_rows_are_dropped_and_the_run_reports_it(
    storage: Storage, record: RunRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(CurrentRun, "most_rows", 30)
    lock = Locked(storage, monkeypatch)
    writer = Writer(patience_s=0.0)
    run = CurrentRun(record, storage, writer, lambda: 0.0)
    drive(run, range(100))
    lock.locked = False
    writer.start()
    ended = end(run, writer)
    assert [row.time for row in storage.speeds(record.id)] == list(range(70, 100))
    assert ended.reason is not None
    assert "70 speeds were lost" in ended.reason
