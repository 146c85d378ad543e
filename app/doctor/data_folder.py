"""Checks of the data folder and its database that change neither."""

from __future__ import annotations

import os
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from app.doctor.finding import Finding, Section
from app.settings import DATABASE_FILE, Settings

if TYPE_CHECKING:
    from sqlalchemy import URL

_SECTION = Section("Data")
_ELSEWHERE = "choose another folder with --data"
_MEGABYTE = 1_000_000
# A run of an hour takes some ten megabytes.
_LITTLE_SPACE = 1000 * _MEGABYTE
_NO_SPACE = 20 * _MEGABYTE
_WAIT_S = 2.0


def examine_data(settings: Settings) -> Iterator[Finding]:
    """Check the folder, its free space and the database."""
    found = list(_folder(settings.data))
    yield from found
    if settings.database is None:
        if all(finding.level != "problem" for finding in found):
            yield _sqlite(settings.data / DATABASE_FILE)
        return
    # Imported here and below: the database packages take as long to import as all the rest.
    from app.storage.engines import database_url
    from app.storage.errors import StorageError

    try:
        url = database_url(settings.database)
    except StorageError as error:
        yield _SECTION.problem(str(error))
        return
    if url.get_backend_name() == "sqlite":
        yield _sqlite(Path(str(url.database)).absolute())
    else:
        yield _server(url)


def _folder(folder: Path) -> Iterator[Finding]:
    present = _nearest(folder)
    if not present.is_dir():
        yield _SECTION.problem(f"{present} is a file, not a folder; {_ELSEWHERE}")
        return
    if not os.access(present, os.W_OK | os.X_OK):
        yield _SECTION.problem(_not_writable(folder, exists=present == folder))
        return
    if present == folder:
        yield _SECTION.ok(f"runs and settings are kept in {folder}")
    else:
        yield _SECTION.ok(f"runs and settings will be kept in {folder} (created at start)")
    yield _space(present, shutil.disk_usage(present).free)


def _not_writable(folder: Path, *, exists: bool) -> str:
    # Only this folder is named: its parent may belong to the system.
    if exists:
        return (
            f"you have no permission to write to {folder}; {_ELSEWHERE}, or become its owner: sudo "
            f"chown $USER {folder}"
        )
    return (
        f"you have no permission to create {folder}; {_ELSEWHERE}, or create it with: sudo install "
        f"-d -o $USER {folder}"
    )


def _nearest(folder: Path) -> Path:
    """Return the folder, or its nearest existing parent."""
    return next(each for each in (folder, *folder.parents) if os.path.lexists(each))


def _space(folder: Path, free: int) -> Finding:
    text = f"{_size(free)} free"
    if free < _NO_SPACE:
        return _SECTION.problem(
            f"only {text} at {folder}, too little for the database; free some space, or "
            f"{_ELSEWHERE}"
        )
    if free < _LITTLE_SPACE:
        return _SECTION.warning(f"only {text} at {folder}; free some space before long runs")
    return _SECTION.ok(text)


def _size(count: int) -> str:
    if count < 1000 * _MEGABYTE:
        return f"{count / _MEGABYTE:.0f} MB"
    return f"{count / (1000 * _MEGABYTE):.0f} GB"


def _sqlite(file: Path) -> Finding:
    if not os.path.lexists(file):
        return _SECTION.ok("the database will be created at the first start")
    if not os.access(file, os.R_OK | os.W_OK):
        return _SECTION.problem(
            f"you have no permission to write to the database {file}; {_ELSEWHERE}, or become its "
            f"owner: sudo chown $USER {file}"
        )
    try:
        # Read-only: faults are reported here and repaired by serve, which keeps a copy.
        uri = f"{file.as_uri()}?mode=ro{'&immutable=1' if _is_at_rest(file) else ''}"
        with closing(sqlite3.connect(uri, uri=True, timeout=_WAIT_S)) as db:
            (answer,) = db.execute("PRAGMA quick_check(1)").fetchone()
            tables = {name for (name,) in db.execute("SELECT name FROM sqlite_schema")}
            has_revision = "alembic_version" in tables
            query = "SELECT version_num FROM alembic_version"
            row = db.execute(query).fetchone() if has_revision else None
    except sqlite3.Error as error:
        return _unreadable(file, error)
    except OSError as error:
        return _SECTION.problem(f"the database {file} cannot be read ({error.strerror})")
    if answer != "ok":
        return _moved_aside(file, str(answer))
    return _revision(str(file), row[0] if row else None, bool(tables), f"; {_ELSEWHERE}")


def _is_at_rest(file: Path) -> bool:
    """Return whether the file uses a write-ahead log and nobody has it open (so the log is gone).

    An ordinary read of such a file would leave a log and its index beside it, perhaps owned by
    root.
    """
    with file.open("rb") as opened:
        # https://www.sqlite.org/fileformat.html, file format version numbers: 2 is WAL.
        keeps_log = opened.read(20)[18:20] == b"\x02\x02"
    return keeps_log and not file.with_name(f"{file.name}-wal").exists()


def _unreadable(file: Path, error: sqlite3.Error) -> Finding:
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    if code in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB):
        return _moved_aside(file, str(error))
    if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
        return _SECTION.problem(f"the database {file} is locked by another program; close it")
    return _SECTION.problem(f"the database {file} cannot be opened ({error}); {_ELSEWHERE}")


def _moved_aside(file: Path, reason: str) -> Finding:
    sentence = " ".join(reason.split())
    return _SECTION.warning(
        f"the database {file} is damaged ({sentence}); the next start renames it and creates a new "
        "one: restore a backup before that, if you have one"
    )


def _revision(where: str, revision: str | None, has_tables: bool, remedy: str) -> Finding:
    if revision is None and has_tables:
        return _SECTION.problem(f"the database {where} belongs to another program{remedy}")
    from alembic.script import ScriptDirectory

    from app.storage.migration import alembic_config

    script = ScriptDirectory.from_config(alembic_config())
    if revision not in {None, *(each.revision for each in script.walk_revisions())}:
        return _SECTION.problem(
            f"the database {where} was written by a newer version of dynamic-observer; upgrade"
            f"{remedy.replace(';', ', or', 1)}"
        )
    later = "" if revision == script.get_current_head() else " (upgraded at start)"
    return _SECTION.ok(f"the database is intact{later}")


def _server(url: URL) -> Finding:
    from alembic.runtime.migration import MigrationContext
    from sqlalchemy import inspect
    from sqlalchemy.exc import SQLAlchemyError

    from app.storage.engines import open_engine

    other = "; name another one with --database, or omit it to use a file"
    shown = url.render_as_string(hide_password=True)
    try:
        with open_engine(url, _WAIT_S) as engine, engine.connect() as connection:
            revision = MigrationContext.configure(connection).get_current_revision()
            tables = inspect(connection).get_table_names()
    except SQLAlchemyError as error:
        why = " ".join(str(getattr(error, "orig", None) or error).split())
        return _SECTION.problem(
            f"the database {shown} cannot be reached ({why}); check that its server is running, or "
            "omit --database to use a file"
        )
    found = _revision(shown, revision, bool(tables), other)
    if found.level != "ok":
        return found
    return _SECTION.ok(f"{found.text}; it is {shown}")
