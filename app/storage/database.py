"""Opening a database, and sessions on it that raise the storage's errors."""

from __future__ import annotations

import sqlite3
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Self

import structlog
from sqlalchemy import Engine
from sqlalchemy.exc import DBAPIError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError
from sqlalchemy.orm import Session

from app.settings import DATABASE_FILE
from app.storage.engines import BUSY_TIMEOUT_S, database_url, make_engine, use_write_ahead_log
from app.storage.errors import StorageBusy, StorageError, storage_error
from app.storage.folder import DataFolder
from app.storage.integrity import move_aside_if_damaged
from app.storage.migration import upgrade
from observer.recording.run_folder import RUNS

log = structlog.get_logger(__name__)


class Database:
    """Database: opening, migration and closing, with read and write sessions for the table classes.

    Args:
        location: a file's path, or an SQLAlchemy URL (``sqlite:////data/observer.sqlite``,
            ``postgresql://user:password@host/database``).
        folder: the data folder for the files of runs and truths; the folder of the SQLite file if
            left out. Required with a database server.
        busy_timeout_s: how long a call waits for another writer before ``StorageBusy``.

    Attributes:
        folder: the data kept in files.
        warnings: sentences for the person who started the server, filled by ``open``.

    Raises:
        StorageError: the location is invalid, or its driver or the folder is missing.
    """

    def __init__(
        self,
        location: str | Path,
        *,
        folder: Path | None = None,
        busy_timeout_s: float = BUSY_TIMEOUT_S,
    ) -> None:
        self._url = database_url(location)
        file = self.file
        if folder is None and file is None:
            raise StorageError(
                "in addition to a database server, a folder for the files of runs is needed"
            )
        self.folder = DataFolder((folder or (file or Path()).parent).expanduser().absolute())
        self._busy_timeout_s = busy_timeout_s
        self._engine: Engine | None = None
        # Writers of this process queue here; SQLite's own lock only arbitrates between processes,
        # and by polling, which starves the writer that sleeps longest.
        self._write_lock = threading.Lock()
        self.warnings: tuple[str, ...] = ()

    @property
    def where(self) -> str:
        """Return the database's name for people: a path, or a URL without its password."""
        file = self.file
        return str(file) if file else self._url.render_as_string(hide_password=True)

    @property
    def file(self) -> Path | None:
        """Return the SQLite file; None for a database server."""
        if self._url.get_backend_name() != "sqlite":
            return None
        return Path(str(self._url.database))

    def open(self) -> Self:
        """Make the database ready: move damaged files aside, apply migrations. Idempotent.

        Raises:
            StorageBusy: another program holds it.
            StorageError: it cannot be created or read, or belongs to a newer version.
        """
        if self._engine is not None:
            return self
        if self.file is not None:
            self._prepare_file(self.file)
            self._tell_of_lost_runs(self.file)
        engine = make_engine(self._url, self._busy_timeout_s)
        try:
            with self._translated():
                upgrade(engine, self.file or self.folder.path / DATABASE_FILE)
                if self.file is not None:
                    use_write_ahead_log(engine)
        except BaseException:
            engine.dispose()
            raise
        self._engine = engine
        return self

    def _tell_of_lost_runs(self, file: Path) -> None:
        """Warn if there are runs' files, but a database that knows of none."""
        if file.exists() and file.stat().st_size > 0:
            return
        runs = self.folder.path / RUNS
        count = sum(1 for each in runs.iterdir() if each.is_dir()) if runs.is_dir() else 0
        if count:
            sentence = (
                f"the database {file} is empty, although {runs} contains files of runs ({count}): "
                "they are not listed; restore a backup, or open their recordings by path"
            )
            log.warning("database_empty", file=str(file), runs=count)
            self.warnings = (*self.warnings, sentence)

    def close(self) -> None:
        """Close all connections. Idempotent; waits for a write in progress."""
        with self._write_lock:
            engine, self._engine = self._engine, None
        if engine is not None:
            engine.dispose()

    def __enter__(self) -> Self:
        return self.open()

    def __exit__(self, *_: object) -> None:
        self.close()

    @contextmanager
    def _reading(self) -> Iterator[Session]:
        with self._translated(), Session(self._opened(), expire_on_commit=False) as session:
            yield session

    @contextmanager
    def _writing(self) -> Iterator[Session]:
        """Yield one transaction: committed at the end, rolled back on an error."""
        if not self._write_lock.acquire(timeout=self._busy_timeout_s):
            raise StorageBusy(
                f"the database {self.where} is busy with another write; try again later"
            )
        try:
            engine = self._opened().execution_options(writes=True)
            with self._translated(), Session(engine) as session, session.begin():
                yield session
        finally:
            self._write_lock.release()

    def _opened(self) -> Engine:
        if self._engine is None:
            raise StorageError(f"the database {self.where} is not open")
        return self._engine

    @contextmanager
    def _translated(self) -> Iterator[None]:
        try:
            yield
        except DBAPIError as error:
            raise storage_error(error.orig, self.where) from error
        except sqlite3.Error as error:
            raise storage_error(error, self.where) from error
        except PoolTimeoutError as error:
            raise StorageBusy(
                f"the database {self.where} has too many simultaneous readers; try again later"
            ) from error

    def _prepare_file(self, file: Path) -> None:
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StorageError(
                f"the folder {file.parent} for the database cannot be made ({error.strerror}); "
                "choose a folder that you may write to"
            ) from error
        moved = move_aside_if_damaged(file, self._busy_timeout_s)
        if moved is not None:
            kept_as, reason = moved
            sentence = (
                f"the database {file} was damaged ({reason}); it was moved to {kept_as} and a new "
                "one was created"
            )
            log.warning("database_moved_aside", file=str(file), kept_as=str(kept_as), reason=reason)
            self.warnings = (*self.warnings, sentence)
