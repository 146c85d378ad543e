"""Damage, locks, full disks and killed processes, on real SQLite files."""

from __future__ import annotations

import os
import resource
import signal
import sqlite3
import subprocess
import sys
import textwrap
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path

import pytest
import structlog

from app.storage import RunState, SpeedRow, Storage, StorageBusy, StorageError, StorageFull
from app.storage.errors import StorageReadOnly, storage_error


@pytest.fixture
def storage(file: Path) -> Iterator[Storage]:
    with Storage(file) as opened:
        yield opened


def fill(file: Path, rows: int = 2000) -> str:
    with Storage(file) as storage:
        run = storage.create_run(name="r", source="s", parameters={}, versions={})
        storage.append_speeds(
            SpeedRow(run.id, i / 10, "obstacle", "estimate", 1, 0.5, 0.1, 0) for i in range(rows)
        )
    return run.id


def test_the_write_ahead_log_is_enabled(file: Path, storage: Storage) -> None:
    storage.set_setting("a", 1)
    with closing(sqlite3.connect(file)) as connection:
        assert connection.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    assert file.with_name(file.name + "-wal").exists()


def test_a_path_and_a_url_open_the_same_database(tmp_path: Path) -> None:
    file = tmp_path / "a folder" / "data 100%.sqlite"
    with Storage(file) as storage:
        storage.set_setting("a", 1)
        assert storage.file == file
    with Storage(f"sqlite:///{file}") as storage:
        assert storage.get_setting("a") == 1
        assert storage.warnings == ()


@pytest.mark.parametrize(
    "location", [":memory:", "sqlite://", "sqlite:///:memory:", "://", "x://y"]
)
def test_unusable_locations_are_refused(location: str) -> None:
    with pytest.raises(StorageError) as caught:
        Storage(location).open()
    assert str(caught.value).count("\n") == 0


def test_storage_can_be_opened_and_closed_repeatedly(file: Path) -> None:
    storage = Storage(file)
    assert storage.open() is storage.open()
    storage.close()
    storage.close()
    with pytest.raises(StorageError, match="not open"):
        storage.list_runs()
    with storage:
        assert storage.list_runs() == []


def overwrite_all(file: Path) -> None:
    file.write_bytes(b"this was never a database, " * 400)


def overwrite_the_middle(file: Path) -> None:
    with file.open("r+b") as stream:
        stream.seek(3 * 4096)
        stream.write(b"\xff" * 5 * 4096)


def cut_in_half(file: Path) -> None:
    with file.open("r+b") as stream:
        stream.truncate(file.stat().st_size // 2)


@pytest.mark.parametrize("damage", [overwrite_all, overwrite_the_middle, cut_in_half])
def test_a_damaged_database_is_moved_aside(file: Path, damage: Callable[[Path], None]) -> None:
    fill(file)
    damage(file)
    damaged = file.read_bytes()
    with structlog.testing.capture_logs() as logs, Storage(file) as storage:
        assert storage.list_runs() == []
        storage.set_setting("usable", True)
    (kept,) = file.parent.glob("observer.corrupt-*.sqlite")
    assert kept.read_bytes() == damaged
    (sentence,) = storage.warnings
    assert str(kept) in sentence
    assert [entry["event"] for entry in logs if entry["log_level"] == "warning"] == [
        "database_moved_aside"
    ]
    with Storage(file) as storage:
        assert storage.get_setting("usable") is True
        assert storage.warnings == ()


@pytest.mark.parametrize("empty", [True, False])
def test_a_database_lacking_the_folders_runs_gives_a_warning(tmp_path: Path, empty: bool) -> None:
    (tmp_path / "runs" / "20260101-120000-abcdef").mkdir(parents=True)
    if empty:
        (tmp_path / "observer.sqlite").touch()
    with Storage(tmp_path / "observer.sqlite") as storage:
        (warning,) = storage.warnings
        assert "files of runs (1)" in warning
    with Storage(tmp_path / "observer.sqlite") as storage:
        assert storage.warnings == ()


def test_the_wal_of_a_damaged_database_is_not_applied_to_the_new_one(file: Path) -> None:
    storage = Storage(file).open()
    storage.set_setting("old", 1)
    wal = file.with_name(file.name + "-wal")
    log = wal.read_bytes()
    storage.close()
    overwrite_all(file)
    wal.write_bytes(log)
    with Storage(file) as storage:
        assert storage.get_setting("old") is None
        assert len(storage.warnings) == 1


def test_another_programs_database_is_unchanged(file: Path) -> None:
    with closing(sqlite3.connect(file)) as connection:
        connection.execute("CREATE TABLE recipes (name TEXT)")
        connection.commit()
    before = file.read_bytes()
    with pytest.raises(StorageError, match="another program"):
        Storage(file).open()
    assert file.read_bytes() == before


def test_a_folder_that_cannot_be_created_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageError, match="choose a folder"):
        Storage(tmp_path / "file" / "observer.sqlite").open()
    (tmp_path / "folder.sqlite").mkdir()
    with pytest.raises(StorageError, match="cannot be opened"):
        Storage(tmp_path / "folder.sqlite").open()


@contextmanager
def locked(file: Path) -> Iterator[None]:
    with closing(sqlite3.connect(file, isolation_level=None)) as other:
        other.execute("BEGIN EXCLUSIVE")
        yield
        other.execute("ROLLBACK")


def test_a_locked_database_is_busy_and_works_afterwards(file: Path) -> None:
    fill(file, rows=1)
    with Storage(file, busy_timeout_s=0.2) as storage:
        with locked(file):
            with pytest.raises(StorageBusy, match="locked by another program"):
                storage.set_setting("a", 1)
            # With a write-ahead log readers do not wait for a writer.
            assert len(storage.list_runs()) == 1
        storage.set_setting("a", 2)
        assert storage.get_setting("a") == 2


def test_a_database_locked_while_opening_is_busy(file: Path) -> None:
    fill(file, rows=1)
    with closing(sqlite3.connect(file, isolation_level=None)) as other:
        # In this mode not even readers get in.
        other.execute("PRAGMA locking_mode=EXCLUSIVE")
        other.execute("BEGIN EXCLUSIVE")
        other.execute("DELETE FROM settings")
        with pytest.raises(StorageBusy):
            Storage(file, busy_timeout_s=0.2).open()
        other.execute("COMMIT")
    with Storage(file) as storage:
        assert len(storage.list_runs()) == 1
    assert not list(file.parent.glob("*corrupt*"))


FILL_THE_DISK = """
    import resource, signal, sys
    from app.storage import Storage, StorageFull, StorageError

    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    with Storage(sys.argv[1]) as storage:
        storage.set_setting("before", 1)
        resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))
        try:
            storage.set_setting("much", "x" * 3_000_000)
        except StorageError as error:
            print(type(error).__name__)
        assert storage.get_setting("before") == 1
        assert storage.get_setting("much") is None
"""


def test_a_write_beyond_the_file_size_limit_is_a_storage_error(file: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(FILL_THE_DISK), str(file)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] in ("StorageFull", "StorageError")
    with Storage(file) as storage:
        assert storage.get_setting("before") == 1


def test_a_full_disk_is_reported_and_loses_nothing(storage: Storage) -> None:
    storage.set_setting("before", 1)
    # A page limit gives the very error that a full disk gives, without filling one.
    with storage._writing() as session:
        session.connection().exec_driver_sql("PRAGMA max_page_count=40")
    with pytest.raises(StorageFull, match="free some disk space"):
        storage.set_setting("much", "x" * 3_000_000)
    with storage._writing() as session:
        session.connection().exec_driver_sql("PRAGMA max_page_count=1000000")
    storage.set_setting("much", "x" * 3_000_000)
    assert storage.get_setting("before") == 1


def test_a_file_that_cannot_be_written_is_named_with_the_remedy(tmp_path: Path) -> None:
    file = tmp_path / "kept.sqlite"
    sqlite3.connect(file).close()
    with (
        closing(sqlite3.connect(f"file:{file}?mode=ro", uri=True)) as connection,
        pytest.raises(sqlite3.OperationalError) as caught,
    ):
        connection.execute("CREATE TABLE a (b)")
    error = storage_error(caught.value, "kept.sqlite")
    assert isinstance(error, StorageReadOnly)
    assert "kept.sqlite cannot be written (attempt to write a readonly database)" in str(error)


def test_too_many_open_files_are_named_as_the_cause(tmp_path: Path) -> None:
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    with pytest.raises(sqlite3.OperationalError) as caught:
        sqlite3.connect(tmp_path / "gone" / "data.sqlite")
    with ExitStack() as files:
        lowest_free = files.enter_context(Path(os.devnull).open()).fileno()
        try:
            resource.setrlimit(resource.RLIMIT_NOFILE, (lowest_free, before[1]))
            error = storage_error(caught.value, "data.sqlite")
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, before)
    assert isinstance(error, StorageBusy)
    assert "because the server has too many open files; close" in str(error)
    assert isinstance(storage_error(caught.value, "data.sqlite"), StorageReadOnly)


WRITE_FOR_EVER = """
    import sys
    from app.storage import SpeedRow, Storage

    storage = Storage(sys.argv[1]).open()
    run = storage.create_run(name="r", source="s", parameters={}, versions={})
    batch = 0
    while True:
        storage.append_speeds(
            [SpeedRow(run.id, float(batch), "obstacle", "estimate", i, 0.5, 0.1, 0)
             for i in range(50)]
        )
        storage.update_run(run.id, frames=batch + 1)
        print("kept", batch, flush=True)
        batch += 1
"""


@pytest.mark.parametrize("batches", [1, 3, 20])
def test_a_killed_writer_loses_nothing_committed(file: Path, batches: int) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(WRITE_FOR_EVER), str(file)],
        stdout=subprocess.PIPE,
        text=True,
    ) as writer:
        assert writer.stdout is not None
        kept = -1
        for line in writer.stdout:
            if line.startswith("kept"):
                kept = int(line.split()[1])
            if kept + 1 >= batches:
                break
        writer.send_signal(signal.SIGKILL)
    with Storage(file) as storage:
        assert storage.warnings == ()
        (run,) = storage.mark_interrupted_runs()
        assert run.state is RunState.INTERRUPTED
        assert run.frames >= kept + 1
        assert run.started_at < run.updated_at == run.ended_at
        rows = storage.speeds(run.id)
        assert len(rows) % 50 == 0
        assert len(rows) >= 50 * (kept + 1)
        storage.append_speeds(rows[:1])
    with closing(sqlite3.connect(file)) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)


def test_a_writer_killed_in_its_first_transaction_leaves_a_usable_file(file: Path) -> None:
    script = """
        import os, sys
        from app.storage import Storage

        storage = Storage(sys.argv[1]).open()
        with storage._writing() as session:
            session.connection().exec_driver_sql("DELETE FROM alembic_version")
            os.kill(os.getpid(), 9)
    """
    with pytest.raises(subprocess.CalledProcessError):
        subprocess.run(
            [sys.executable, "-c", textwrap.dedent(script), str(file)],
            check=True,
            timeout=60,
            capture_output=True,
        )
    with Storage(file) as storage:
        assert storage.list_runs() == []
