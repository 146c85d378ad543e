"""Backup and restoration, from and into databases of both kinds."""

from __future__ import annotations

import sqlite3
import threading
from collections.abc import Callable
from contextlib import closing
from datetime import timedelta
from pathlib import Path

import pytest

from app.storage import Storage, StorageError
from app.storage.backup import write_backup
from app.storage.bundle import BackupError
from app.storage.restore import Restored, restore_backup

from .backups import back_up, contents, fill, speeds


@pytest.mark.parametrize("name", ["kept.zip", "kept.tar"])
def test_everything_is_restored_between_either_kind_of_database(
    location: str | Path, opened: Callable[[], Storage], tmp_path: Path, name: str
) -> None:
    told: list[tuple[int, int | None]] = []
    with opened() as storage:
        run_id = fill(storage)
        before = contents(storage, run_id)
        manifest = back_up(
            storage, location, tmp_path / name, progress=lambda *now: told.append(now)
        )
    assert told[-1][0] == told[-1][1] == sum(each.size for each in manifest.files.values())
    data = tmp_path / "elsewhere"
    done = restore_backup(tmp_path / name, data, data / "observer.sqlite", replace=False)
    assert (done.manifest, done.kept) == (manifest, ())
    with Storage(data / "observer.sqlite") as storage:
        assert contents(storage, run_id) == before
    assert not (data / "token").exists()
    assert [each.name for each in data.iterdir() if each.name.startswith(".")] == []
    # And back, over existing data.
    with pytest.raises(BackupError, match="--replace"):
        restore_backup(tmp_path / name, tmp_path, location, replace=False)
    with opened() as storage:
        storage.delete_run(run_id)
        (tmp_path / "rig.yaml").write_text("changed")
        after = contents(storage, run_id)
    done = restore_backup(tmp_path / name, tmp_path, location, replace=True)
    with opened() as storage:
        assert contents(storage, run_id) == before
        # New row numbers continue after the restored ones.
        storage.append_speeds(speeds(run_id, 1, 2100))
        assert storage.speeds(run_id)[-1].track_id == 2100
    folder, database = done.kept
    assert (folder / "rig.yaml").read_text() == "changed"
    database.rename(folder / "observer.sqlite")
    with Storage(folder / "observer.sqlite") as storage:
        assert contents(storage, run_id) == after


def test_a_backup_during_writes_is_a_consistent_snapshot(
    location: str | Path, opened: Callable[[], Storage], tmp_path: Path
) -> None:
    with opened() as storage:
        run = storage.create_run(name="r", source="s", parameters={}, versions={})
        ending = threading.Event()

        def write() -> None:
            batch = 0
            while not ending.is_set():
                # As a run's rows are written: each batch, then their number.
                storage.append_speeds(speeds(run.id, 50, 50 * batch))
                batch += 1
                storage.update_run(run.id, frames=50 * batch)

        thread = threading.Thread(target=write)
        thread.start()
        try:
            for i in range(3):
                back_up(storage, location, tmp_path / f"{i}.zip")
        finally:
            ending.set()
            thread.join()
    seen = []
    for i in range(3):
        data = tmp_path / f"restored-{i}"
        restore_backup(tmp_path / f"{i}.zip", data, data / "observer.sqlite", replace=False)
        with Storage(data / "observer.sqlite") as storage:
            (found,) = storage.list_runs()
            rows = storage.speeds(run.id)
            assert rows == speeds(run.id, len(rows))
            assert len(rows) - found.frames in (0, 50)
            seen.append(len(rows))
    assert seen == sorted(seen)
    assert seen[-1] > seen[0]


def test_recordings_can_be_excluded_and_stay_in_place(
    kept: tuple[Path, str], tmp_path: Path
) -> None:
    _, run_id = kept
    data = tmp_path / "first"
    recording = data / "runs" / run_id / "recording.mcap"
    content = recording.read_bytes()
    small = tmp_path / "small.zip"
    with Storage(data / "observer.sqlite") as storage:
        manifest = back_up(storage, data / "observer.sqlite", small, recordings=False)
    assert [name for name in manifest.files if name.endswith(".mcap")] == []
    assert f"runs/{run_id}/truth/as uploaded ä.csv" in manifest.files
    assert small.stat().st_size < 250_000
    done = restore_backup(small, data, data / "observer.sqlite", replace=True)
    assert recording.read_bytes() == content
    assert (data / "clips" / "clip-1.mcap").read_bytes() == b"the last half minute"
    with Storage(data / "observer.sqlite") as storage:
        storage.discard_run(run_id)
        storage.purge(timedelta(0))
    assert not recording.exists()
    assert (done.kept[0] / "runs" / run_id / "recording.mcap").read_bytes() == content


def test_a_failed_backup_is_reported_and_leaves_nothing(tmp_path: Path) -> None:
    def back_up_of(data: Path, target: Path) -> None:
        write_backup(target, data, data / "observer.sqlite", recordings=True, application="1")

    with pytest.raises(BackupError, match="there is no database"):
        back_up_of(tmp_path / "nothing", tmp_path / "a.zip")
    data = tmp_path / "data"
    with Storage(data / "observer.sqlite"):
        pass
    with pytest.raises(BackupError, match=r"must end in \.zip or \.tar"):
        back_up_of(data, tmp_path / "a.rar")
    with pytest.raises(BackupError, match="cannot write"):
        back_up_of(data, tmp_path / "no folder" / "a.zip")
    (data / "observer.sqlite").write_bytes(b"no database" * 900)
    with pytest.raises(StorageError, match="is damaged"):
        back_up_of(data, tmp_path / "a.zip")
    with closing(sqlite3.connect(data / "other.sqlite")) as connection:
        connection.execute("CREATE TABLE recipes (name TEXT)")
    with pytest.raises(BackupError, match="does not belong to dynamic-observer"):
        write_backup(
            tmp_path / "a.zip", data, data / "other.sqlite", recordings=True, application="1"
        )
    assert [each.name for each in tmp_path.iterdir()] == ["data"]


def test_a_restored_running_run_is_interrupted_at_the_next_start(
    tmp_path: Path,
) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    with Storage(first / "observer.sqlite") as storage:
        run = storage.create_run(name="r", source="s", parameters={}, versions={})
        back_up(storage, first / "observer.sqlite", tmp_path / "a.tar")
    done: Restored = restore_backup(
        tmp_path / "a.tar", second, second / "observer.sqlite", replace=False
    )
    assert done.manifest.recordings
    with Storage(second / "observer.sqlite") as storage:
        assert [each.id for each in storage.mark_interrupted_runs()] == [run.id]
