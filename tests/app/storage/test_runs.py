from __future__ import annotations

import json
import math
import threading
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime, timedelta

import pytest

from app.storage import (
    RunRecord,
    RunState,
    SpeedRow,
    Storage,
    StorageError,
    StorageMissing,
)


def speed(run_id: str, time: float = 0.0, **changes: object) -> SpeedRow:
    row = SpeedRow(run_id, time, "obstacle", "estimate", 1, 0.5, 0.1, 0)
    return replace(row, **changes)  # type: ignore[arg-type]


def test_a_run_is_stored_across_reopening(opened: Callable[[], Storage]) -> None:
    with opened() as storage:
        made = storage.create_run(
            name="Fahrt Ä",
            source="../shared/data/kitti_oncoming",
            parameters={"flow.residual_threshold_px": 1.25, "ego_motion.model": "affine"},
            versions={"opencv": "4.13"},
        )
        assert made.state is RunState.RUNNING
        assert made.ended_at is None
    with opened() as storage:
        assert storage.get_run(made.id) == made
        assert storage.list_runs() == [made]


def test_times_are_utc_with_offset(run: RunRecord) -> None:
    assert datetime.fromisoformat(run.started_at).utcoffset() == timedelta(0)
    assert len(run.started_at) == 32


def test_runs_are_listed_newest_first_and_in_pages(storage: Storage) -> None:
    made = [
        storage.create_run(name=f"run {i}", source="s", parameters={}, versions={})
        for i in range(4)
    ]
    assert [run.name for run in storage.list_runs()] == ["run 3", "run 2", "run 1", "run 0"]
    assert [run.name for run in storage.list_runs(limit=2, offset=1)] == ["run 2", "run 1"]
    assert len({run.id for run in made}) == 4


def test_update_changes_only_what_is_given(storage: Storage, run: RunRecord) -> None:
    changed = storage.update_run(run.id, frames=12, segments=2)
    assert changed == replace(run, frames=12, segments=2, updated_at=changed.updated_at)
    assert changed.updated_at > run.updated_at
    ended = storage.update_run(run.id, state=RunState.FAILED, reason="the disk is full")
    assert (ended.state, ended.reason, ended.frames) == (RunState.FAILED, "the disk is full", 12)
    assert ended.ended_at == ended.updated_at
    assert storage.get_run(run.id) == ended


def test_an_unknown_run_is_missing_or_refused(storage: Storage) -> None:
    assert storage.get_run("nothing") is None
    assert storage.delete_run("nothing") is False
    assert storage.speeds("nothing") == []
    with pytest.raises(StorageMissing, match="no run nothing"):
        storage.update_run("nothing", frames=1)
    with pytest.raises(StorageMissing):
        storage.append_speeds([speed("nothing")])
    with pytest.raises(StorageMissing):
        storage.record_parameter_revision("nothing", 0, 1, {})


def test_a_run_needs_a_saved_calibration(storage: Storage) -> None:
    with pytest.raises(StorageMissing):
        storage.create_run(
            name="r", source="s", parameters={}, versions={}, calibration_id="0" * 64
        )
    assert storage.list_runs() == []


def test_running_runs_are_interrupted_at_their_last_heartbeat(storage: Storage) -> None:
    finished, running = (
        storage.create_run(name=name, source="s", parameters={}, versions={})
        for name in ("finished", "running")
    )
    finished = storage.update_run(finished.id, state=RunState.FINISHED)
    alive = storage.update_run(running.id, frames=7)
    (interrupted,) = storage.mark_interrupted_runs()
    assert interrupted.id == running.id
    assert interrupted.state is RunState.INTERRUPTED
    assert interrupted.ended_at == alive.updated_at
    assert interrupted.frames == 7
    assert interrupted.reason
    assert storage.get_run(finished.id) == finished
    assert storage.mark_interrupted_runs() == []


def test_speeds_keep_order_gaps_and_every_digit(storage: Storage, run: RunRecord) -> None:
    # The file looped after the second row: time starts again, the order of writing stays.
    rows = [
        speed(run.id, 0.1, speed=1 / 3, std=math.pi),
        speed(run.id, 0.2, speed=None, std=None),
        speed(run.id, 0.1, source="truth", track_id=None, std=None, segment=1),
        speed(run.id, 0.1, source="commanded", role="observer", segment=1),
    ]
    assert storage.append_speeds(rows[:3]) == 3
    assert storage.append_speeds(iter(rows[3:])) == 1
    assert storage.append_speeds([]) == 0
    assert storage.speeds(run.id) == rows


def test_unknown_speeds_are_gaps_and_unknown_times_are_refused() -> None:
    row = speed("r", speed=math.nan, std=math.inf)
    assert row.speed is None
    assert row.std is None
    with pytest.raises(ValueError, match="finite time"):
        speed("r", math.nan)


def test_a_refused_batch_stores_nothing(storage: Storage, run: RunRecord) -> None:
    with pytest.raises(StorageMissing):
        storage.append_speeds([speed(run.id), speed("nothing")])
    assert storage.speeds(run.id) == []


def test_deleting_a_run_deletes_its_speeds_and_revisions(storage: Storage, run: RunRecord) -> None:
    other = storage.create_run(name="other", source="s", parameters={}, versions={})
    for each in (run, other):
        storage.append_speeds([speed(each.id)])
        storage.record_parameter_revision(each.id, 3, 1, {"tracking.gate": 2.0})
    assert storage.delete_run(run.id) is True
    assert storage.speeds(run.id) == []
    assert storage.parameter_revisions(run.id) == []
    assert len(storage.speeds(other.id)) == len(storage.parameter_revisions(other.id)) == 1


def test_threads_write_and_read_concurrently(storage: Storage, run: RunRecord) -> None:
    problems: list[Exception] = []

    def write(track: int) -> None:
        try:
            for i in range(20):
                storage.append_speeds([speed(run.id, i / 10, track_id=track)])
                storage.update_run(run.id, frames=i)
                storage.get_run(run.id)
        except StorageError as error:
            problems.append(error)

    threads = [threading.Thread(target=write, args=(track,)) for track in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert problems == []
    times: dict[int | None, list[float]] = {}
    for row in storage.speeds(run.id):
        times.setdefault(row.track_id, []).append(row.time)
    assert times == {track: [i / 10 for i in range(20)] for track in range(8)}


def test_a_record_is_json_serialisable(run: RunRecord) -> None:
    assert json.loads(json.dumps(vars(run)))["state"] == "running"
