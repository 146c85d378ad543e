"""Integrity check of an SQLite file; a damaged one is moved aside, never deleted."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path

from app.storage.errors import StorageBusy, StorageCorrupt, StorageError, storage_error

# A write-ahead log belongs to its database by name and moves with it.
_COMPANIONS = ("", "-wal", "-shm")


def move_aside_if_damaged(file: Path, timeout_s: float) -> tuple[Path, str] | None:
    """Check the file; if it is damaged, rename it (and its log) beside itself.

    Returns:
        Its new path and the reason; None if it is sound or not there.

    Raises:
        StorageBusy: another program holds it, so that its state is unknown.
        StorageError: it cannot be read or renamed at all (permissions, a folder).
    """
    if not file.exists():
        return None
    reason = damage(file, timeout_s)
    if reason is None:
        return None
    kept_as = name_beside(file, "corrupt")
    try:
        move_with_log(file, kept_as)
    except OSError as error:
        raise StorageError(
            f"the database {file} is damaged and cannot be moved aside ({error.strerror}); move it "
            "manually"
        ) from error
    return kept_as, reason


def name_beside(file: Path, why: str) -> Path:
    """Return a free name beside a file, such as ``observer.corrupt-<UTC>.sqlite``."""
    stamp = f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}"
    name = file.with_name(f"{file.stem}.{why}-{stamp}{file.suffix}")
    number = 1
    while name.exists():
        number += 1
        name = file.with_name(f"{file.stem}.{why}-{stamp}-{number}{file.suffix}")
    return name


def is_open_elsewhere(file: Path) -> bool:
    """Return whether another program has the database open, idle or not."""
    try:
        with closing(sqlite3.connect(file, timeout=0.2, isolation_level=None)) as connection:
            # With a write-ahead log, everybody who has it open holds a lock that this excludes.
            connection.execute("PRAGMA locking_mode=EXCLUSIVE")
            connection.execute("BEGIN EXCLUSIVE")
            connection.execute("ROLLBACK")
    except sqlite3.DatabaseError as error:
        return isinstance(storage_error(error, str(file)), StorageBusy)
    return False


def move_with_log(file: Path, target: Path) -> None:
    """Rename a database with its write-ahead log, which belongs to it by name."""
    for ending in _COMPANIONS:
        companion = file.with_name(file.name + ending)
        if companion.exists():
            companion.rename(target.with_name(target.name + ending))


def copy_database(file: Path, copy: Path) -> None:
    """Copy a database that may be open elsewhere, including its write-ahead log."""
    try:
        with closing(sqlite3.connect(file)) as source, closing(sqlite3.connect(copy)) as target:
            source.backup(target)
            # One file without a log beside it, whatever the mode of the source.
            target.execute("PRAGMA journal_mode=DELETE")
    except sqlite3.Error as error:
        copy.unlink(missing_ok=True)
        raise StorageError(
            f"the database {file} cannot be copied to {copy} ({error}); "
            "free some disk space or make the folder writable"
        ) from error


def damage(file: Path, timeout_s: float) -> str | None:
    """Describe the damage of the file; None if it is sound.

    Raises:
        StorageBusy, StorageError: the state is unknown; see ``move_aside_if_damaged``.
    """
    try:
        with closing(sqlite3.connect(file, timeout=timeout_s)) as connection:
            # quick_check reads every page but skips the contents of indices: it takes a tenth of
            # the time of integrity_check, and what it misses costs no data.
            (answer,) = connection.execute("PRAGMA quick_check(1)").fetchone()
    except sqlite3.DatabaseError as error:
        converted = storage_error(error, str(file))
        if isinstance(converted, StorageCorrupt):
            return str(error)
        if isinstance(converted, StorageBusy):
            raise converted from error
        raise StorageError(
            f"the database {file} cannot be opened ({error}); "
            "choose a file in a folder that you may write to"
        ) from error
    return None if answer == "ok" else str(answer).replace("\n", " ")
