"""Restoration of a backup in place of the present data, which is kept beside it."""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from sqlalchemy import Connection, inspect, literal, select, table, text

from app.settings import DATABASE_FILE
from app.storage.backup import FILES, FOLDERS, Progress
from app.storage.bundle import BackupError, Bundle, Manifest, open_bundle
from app.storage.copying import copy_tables, replace_tables
from app.storage.database import Database
from app.storage.engines import APPLICATION, BUSY_TIMEOUT_S, database_url, open_engine
from app.storage.errors import StorageError, translated
from app.storage.folder import CLIPS, FORMER_CLIPS, DataFolder
from app.storage.integrity import damage, is_open_elsewhere, move_with_log, name_beside
from app.storage.migration import upgrade
from app.storage.server_locks import lock_whole
from observer.recording.run_folder import RUNS

_TOP = {DATABASE_FILE, *FILES, *FOLDERS}


@dataclass(frozen=True)
class Restored:
    """Result of a restoration. ``kept``: paths of the previous data."""

    manifest: Manifest
    kept: tuple[Path, ...]


def restore_backup(
    source: Path,
    data: Path,
    location: str | Path,
    *,
    replace: bool,
    progress: Progress | None = None,
) -> Restored:
    """Check a complete backup, then put it in place.

    Recordings that are not in the backup stay with their runs.

    Args:
        replace: restore even if there is data already.

    Raises:
        BackupError: the backup is damaged, newer or too large, there is data already, or a
            server has it open. Nothing was changed.
        StorageError: the database cannot be used. Nothing was changed.
    """
    with open_bundle(source) as bundle:
        _check_names(source, bundle.manifest)
        place = _Place(data.expanduser().absolute(), location)
        place.check(replace)
        place.check_space(sum(entry.size for entry in bundle.manifest.files.values()))
        with _staging(place.data) as staged:
            _extract(bundle, staged, progress)
            _check_database(source, staged / DATABASE_FILE)
            with translated(place.where):
                kept = place.put(staged)
        return Restored(bundle.manifest, kept)


class _Place:
    """Target of a restoration: a data folder, and a database in it or elsewhere."""

    def __init__(self, data: Path, location: str | Path) -> None:
        database = Database(location, folder=data)
        self.data, self.where, self._file = data, database.where, database.file
        self._url = database_url(location)

    def check(self, replace: bool) -> None:
        """Refuse a target in use, and one with data unless it may be replaced."""
        with translated(self.where):
            in_use, rows = self._look()
        if in_use:
            raise BackupError(f"a server is using the database {self.where}; stop it, then restore")
        present = [self.data / name for name in (*FILES, *FOLDERS)]
        filled = [path for path in present if path.is_file() or _has_something(path)]
        if (filled or rows) and not replace:
            what = self.where if rows else str(filled[0])
            raise BackupError(
                f"{what} already exists; use --replace to put the backup in its place and keep the "
                "old data beside it, or name another folder with --data"
            )

    def check_space(self, needed: int) -> None:
        free = DataFolder(self.data).free_bytes()
        if needed > free:
            raise BackupError(
                f"the backup needs {needed // 1_000_000 + 1} MB and {free // 1_000_000} MB are "
                f"free at {self.data}; free some space or name another folder with --data"
            )

    def put(self, staged: Path) -> tuple[Path, ...]:
        """Put all of it in place or nothing; return the paths of the old data."""
        stamp = f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}-{secrets.token_hex(2)}"
        old = self.data / f"before-restore-{stamp}"
        kept: list[Path] = []
        with contextlib.ExitStack() as undo:
            present = [name for name in (*FILES, *FOLDERS) if (self.data / name).exists()]
            if present:
                old.mkdir()
                undo.callback(old.rmdir)
                kept.append(old)
            for name in present:
                _move(self.data / name, old / name, undo)
            for name in (*FILES, *FOLDERS):
                if (staged / name).exists():
                    _move(staged / name, self.data / name, undo)
            for name in (RUNS, CLIPS, FORMER_CLIPS):
                _keep_recordings(old / name, self.data / name)
            if self._file is not None:
                kept += _put_file(staged / DATABASE_FILE, self._file, undo)
            else:
                kept += self._put_rows(staged / DATABASE_FILE)
            undo.pop_all()
        return tuple(kept)

    def _look(self) -> tuple[bool, bool]:
        """Return whether a server has the database open, and whether it has data."""
        if self._file is not None:
            exists = self._file.exists()
            return exists and is_open_elsewhere(self._file), exists
        with open_engine(self._url) as engine, engine.connect() as connection:
            others = connection.scalar(
                text(
                    "SELECT count(*) FROM pg_stat_activity WHERE datname = current_database() "
                    "AND starts_with(application_name, :name) AND pid <> pg_backend_pid()"
                ),
                {"name": APPLICATION},
            )
            return bool(others), _has_rows(connection)

    def _put_rows(self, snapshot: Path) -> list[Path]:
        kept: list[Path] = []
        with open_engine(self._url) as engine:
            with engine.connect() as connection:
                filled = _has_rows(connection)
            if filled:
                kept.append(name_beside(self.data / DATABASE_FILE, "before-restore"))
                copy_tables(engine, kept[0])
            upgrade(engine, None)
            with open_engine(snapshot) as rows, engine.begin() as connection:
                lock_whole(connection)
                replace_tables(rows, connection)
        return kept


def _check_names(source: Path, manifest: Manifest) -> None:
    tops = {name.split("/")[0] for name in manifest.files}
    if DATABASE_FILE not in tops or not tops <= _TOP:
        raise BackupError(
            f"the backup {source} is damaged (its database is missing or it has unexpected files)"
        )


@contextmanager
def _staging(data: Path) -> Iterator[Path]:
    """Yield a folder on the same disk as the data, so that only renaming remains."""
    folder = data / f".restoring-{secrets.token_hex(4)}"
    try:
        folder.mkdir(parents=True)
        yield folder
    except OSError as error:
        raise BackupError(
            f"the backup cannot be put into {data} ({error.strerror or error}); nothing was "
            f"changed: free some space or make the folder writable"
        ) from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _extract(bundle: Bundle, folder: Path, progress: Progress | None) -> None:
    total = sum(entry.size for entry in bundle.manifest.files.values())
    done = 0
    for name, entry in bundle.manifest.files.items():
        bundle.extract(name, folder / name)
        done += entry.size
        if progress is not None:
            progress(done, total)


def _check_database(source: Path, file: Path) -> None:
    """Check that the database is sound, ours and not newer; migrate it."""
    reason = damage(file, BUSY_TIMEOUT_S)
    if reason is not None:
        raise BackupError(f"the backup {source} is damaged ({reason}); use another one")
    try:
        with open_engine(file) as engine:
            upgrade(engine, None)
    except StorageError as error:
        raise BackupError(f"the backup {source} cannot be restored: {error}") from error


def _put_file(staged: Path, file: Path, undo: contextlib.ExitStack) -> list[Path]:
    # The database may be on another disk than the data.
    part = file.with_name(f".{file.name}.restoring")
    file.parent.mkdir(parents=True, exist_ok=True)
    undo.callback(part.unlink, missing_ok=True)
    shutil.copyfile(staged, part)
    kept: list[Path] = []
    if file.exists():
        kept.append(name_beside(file, "before-restore"))
        undo.callback(move_with_log, kept[0], file)
        move_with_log(file, kept[0])
    part.rename(file)
    return kept


def _keep_recordings(old: Path, new: Path) -> None:
    """Hard-link recordings missing from the backup into its runs, which takes no extra space."""
    for recording in old.rglob("*.mcap"):
        target = new / recording.relative_to(old)
        if not target.exists():
            with contextlib.suppress(OSError):
                target.parent.mkdir(parents=True, exist_ok=True)
                os.link(recording, target)


def _move(source: Path, target: Path, undo: contextlib.ExitStack) -> None:
    source.rename(target)
    undo.callback(target.rename, source)


def _has_something(folder: Path) -> bool:
    return folder.is_dir() and any(folder.iterdir())


def _has_rows(connection: Connection) -> bool:
    """Return whether a server's database holds more than its initial contents."""
    inspected = inspect(connection)
    for name in set(inspected.get_table_names()) - {"alembic_version"}:
        if (
            connection.execute(select(literal(1)).select_from(table(name)).limit(1)).first()
            is not None
        ):
            return True
    return False
