"""Backup of all data at one moment, while a server runs."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from alembic.runtime.migration import MigrationContext

from app.settings import CHECK_FOLDER, DATABASE_FILE, PROGRAMME_FOLDER, RIG_FILE
from app.storage.bundle import BackupError, Manifest, bundle_writer
from app.storage.copying import copy_tables
from app.storage.engines import BUSY_TIMEOUT_S, database_url, open_engine
from app.storage.errors import StorageError, translated
from app.storage.folder import CLIPS, FORMER_CLIPS, TRUTHS
from app.storage.integrity import copy_database, damage
from app.storage.records import utc_now
from observer.recording.run_folder import RUNS

# Parts of the data folder to save besides the database; the token and the server's log are private.
FILES = (RIG_FILE,)
FOLDERS = (PROGRAMME_FOLDER, CHECK_FOLDER, TRUTHS, RUNS, CLIPS, FORMER_CLIPS)
_WITH_RECORDINGS = (RUNS, CLIPS, FORMER_CLIPS)
_RECORDINGS = ".mcap"

# Called with (bytes so far, total bytes).
Progress = Callable[[int, int | None], None]


def write_backup(
    target: Path,
    data: Path,
    location: str | Path,
    *,
    recordings: bool,
    application: str,
    progress: Progress | None = None,
) -> Manifest:
    """Write database, rig, programmes, truths and runs' files into one file.

    Args:
        target: ends in .zip or .tar. data: the data folder. location: as for ``Storage``.
        recordings: include the runs' recordings and saved clips, which may be large.
        application: the version to write into it.

    Raises:
        BackupError: there is nothing to back up, or the target cannot be written.
        StorageError: the database cannot be read.
    """
    with _snapshot(location, target.parent) as snapshot, bundle_writer(target) as bundle:
        files = {DATABASE_FILE: snapshot, **_files(data, recordings)}
        total = sum(_size_of(file) for file in files.values())
        done = 0
        for name, file in files.items():
            try:
                done += bundle.add(name, file)
            except FileNotFoundError:
                # Deleted meanwhile by the running server.
                continue
            if progress is not None:
                progress(done, total)
        revision = _revision(snapshot)
        manifest = Manifest(utc_now(), application, revision, recordings, bundle.files)
        bundle.finish(manifest)
    return manifest


@contextmanager
def _snapshot(location: str | Path, beside: Path) -> Iterator[Path]:
    """Yield the database of this moment as a separate SQLite file, deleted after the block."""
    url = database_url(location)
    try:
        # If there is space anywhere, it is where the backup goes.
        folder = Path(tempfile.mkdtemp(prefix=".observer-backup-", dir=beside))
    except OSError as error:
        raise BackupError(
            f"cannot write into {beside} ({error.strerror}); name a file in an existing, writable "
            "folder"
        ) from error
    try:
        snapshot = folder / DATABASE_FILE
        if url.get_backend_name() == "sqlite":
            _copy_file(Path(str(url.database)), snapshot)
        else:
            where = url.render_as_string(hide_password=True)
            with open_engine(url) as engine, translated(where):
                copy_tables(engine, snapshot)
        if not _revision(snapshot):
            raise BackupError(
                "the database does not belong to dynamic-observer; there is nothing to back up"
            )
        yield snapshot
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _copy_file(file: Path, snapshot: Path) -> None:
    if not file.is_file():
        raise BackupError(f"there is no database {file} to back up; name its folder with --data")
    reason = damage(file, BUSY_TIMEOUT_S)
    if reason is not None:
        raise StorageError(
            f"the database {file} is damaged ({reason}); the next start of the server moves it "
            "aside; copy what you need before"
        )
    copy_database(file, snapshot)


def _size_of(file: Path) -> int:
    """Return the size in bytes; 0 if the file is gone."""
    try:
        return file.stat().st_size
    except FileNotFoundError:
        return 0


def _revision(snapshot: Path) -> str:
    with open_engine(snapshot) as engine, engine.connect() as connection:
        return MigrationContext.configure(connection).get_current_revision() or ""


def _files(data: Path, recordings: bool) -> dict[str, Path]:
    """Return the files by name in the backup; skip run folders being deleted."""
    found = {name: data / name for name in FILES if (data / name).is_file()}
    for folder in FOLDERS:
        for file in sorted((data / folder).rglob("*")):
            parts = file.relative_to(data).parts
            hidden = any(part.startswith(".") for part in parts)
            if hidden or not file.is_file() or file.is_symlink():
                continue
            if recordings or folder not in _WITH_RECORDINGS or file.suffix != _RECORDINGS:
                found["/".join(parts)] = file
    return found
