"""What a current run writes into the database."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from app.contract.commands import OpenSource
from app.server.robots.wheels import WheelSample
from app.server.runs.current_run import CurrentRun, speed_rows
from app.server.writer import Writer
from app.storage import RunState, Storage, StorageBusy
from app.workers.frame_results import frame_result


def test_rows_are_written_once_despite_a_locked_database(
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
        # In the time of the source that was open before.
        run.measured(WheelSample("observer", 41.0, 0.4, 0.4, number=0, segment=0))
        run.frames = 1
        run.measured(WheelSample("observer", 1.0, 0.3, 0.25, number=1, segment=0))
        run.flush()
        assert written.wait(5.0)
    finally:
        writer.stop()
    assert [row.speed for row in storage.speeds(record.id)] == [0.3, 0.25]
    assert writer.dropped == 0


class _FastWriter(Writer):
    """Writer whose thread ends a write before ``post`` returns."""

    def post(
        self,
        work: Callable[[], Any],
        done: Callable[[Any, BaseException | None], None] | None = None,
    ) -> bool:
        ended = threading.Event()

        def noted(value: Any, error: BaseException | None) -> None:
            if done is not None:
                done(value, error)
            ended.set()

        taken = super().post(work, noted)
        assert not taken or ended.wait(5.0)
        return taken


def _wheel(at: float, speed: float) -> WheelSample:
    return WheelSample("observer", at, speed, None, number=0, segment=0)


def test_a_write_that_ends_immediately_does_not_stop_later_ones(storage: Storage) -> None:
    storage.open()
    record = storage.create_run(name="a", source="b", parameters={}, versions={})
    writer = _FastWriter()
    writer.start()
    try:
        run = CurrentRun(record, storage, writer, lambda: 0.0)
        run.frames = 1
        for speed in (0.1, 0.2):
            run.measured(_wheel(speed, speed))
            run.flush()
    finally:
        writer.stop()
    assert [row.speed for row in storage.speeds(record.id)] == [0.1, 0.2]


def test_rows_refused_by_a_full_queue_are_written_later(storage: Storage) -> None:
    storage.open()
    record = storage.create_run(name="a", source="b", parameters={}, versions={})
    writer = Writer(queue_length=1)
    assert writer.post(lambda: None)
    run = CurrentRun(record, storage, writer, lambda: 0.0)
    run.frames = 1
    run.measured(_wheel(0.1, 0.1))
    run.flush()
    writer.start()
    try:
        # The queue has room again as soon as the thread has taken the first write.
        deadline = time.monotonic() + 5.0
        while not storage.speeds(record.id) and time.monotonic() < deadline:
            run.flush()
            time.sleep(0.01)
    finally:
        writer.stop()
    assert [row.speed for row in storage.speeds(record.id)] == [0.1]


def test_a_run_duration_is_independent_of_the_wall_clock(storage: Storage) -> None:
    storage.open()
    record = storage.create_run(name="a", source="b", parameters={}, versions={})
    # As if the wall clock suddenly went back an hour.
    record = replace(record, started_at="2031-05-04T03:02:01.000000+00:00")
    now = [70.0]
    writer = Writer()
    run = CurrentRun(record, storage, writer, lambda: now[0])
    now[0] = 72.5
    ended = run.ended(RunState.FINISHED, None)
    assert ended.ended_at == ended.updated_at == "2031-05-04T03:02:03.500000+00:00"
    run.flush()
    writer.start()
    writer.stop()
    kept = storage.get_run(record.id)
    assert kept is not None
    assert kept.updated_at == ended.updated_at


def test_a_coasting_obstacle_is_a_gap(peer: Any) -> None:
    peer.start_process()
    peer._open(OpenSource("s", None, {}, 0))
    event = peer.observe()
    event.line["obstacles"][0]["state"] = "coasting"
    rows = list(speed_rows("run", frame_result(event.line, event.truth)))
    assert [(row.source, row.speed) for row in rows] == [
        ("estimate", None),
        ("truth", 0.4),
        ("commanded", 0.4),
    ]


def test_the_length_is_source_time_not_elapsed_time(storage: Storage, peer: Any) -> None:
    storage.open()
    record = storage.create_run(name="a", source="b", parameters={}, versions={})
    run = CurrentRun(record, storage, Writer(), lambda: 0.0)
    assert run.snapshot().duration_s is None
    peer.start_process()
    peer._open(OpenSource("s", None, {}, 0))

    def observed(time: float, received: float, segment: int = 0) -> None:
        event = peer.observe()
        line = {**event.line, "time": time, "segment": segment}
        run.observed(replace(event, line=line, received=received))

    # At a tenth of real time, as on a busy machine.
    for k in range(21):
        observed(3.0 + k / 20, 100.0 + k / 2)
    assert (run.snapshot().begin_s, run.snapshot().duration_s) == pytest.approx((3.0, 1.0))
    # The next engine reopens the source: its clock starts over.
    run.resumed(1)
    for k in range(11):
        observed(k / 20, 120.0 + k / 2, segment=1)
    ended = run.ended(RunState.FINISHED, None)
    assert ended.duration_s == pytest.approx(1.55)
    run.write_end(ended, None)
    kept = storage.get_run(record.id)
    assert kept is not None
    assert (kept.begin_s, kept.duration_s) == (ended.begin_s, ended.duration_s)
    # The page's curves use the same clock.
    times = [row.time for row in storage.speeds(record.id) if row.source == "commanded"]
    assert times == sorted(times)
    assert (times[0], times[-1]) == pytest.approx((3.0, 4.55))
