"""Exclusive use of a data folder and database: a second server would mark the runs in progress as
interrupted.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from app.settings import DATABASE_FILE
from app.storage.engines import database_url
from app.storage.server_locks import ServedDatabase
from observer.errors import InputError

_NAME = "server.lock"


@contextmanager
def occupied(folder: Path, database: str | None = None) -> Iterator[None]:
    """Hold a data folder and the database during the context, and no longer than the process.

    Without locks in the system or in the folder's file system, nothing is held.

    Args:
        database: path or URL of the database; None for the folder's own.

    Raises:
        InputError: another server holds the folder, or the file of the database.
        StorageError: another server holds the database, or it does not answer, or the URL is
            invalid.
    """
    remedy = "stop it, or give this server its own folder with --data"
    with contextlib.ExitStack() as held:
        held.enter_context(_locked(folder, _NAME, f"is using the folder {folder}; {remedy}"))
        # The folder's own as well: a server with another folder may be given it as its database.
        held.enter_context(_database(database or str(folder / DATABASE_FILE)))
        yield


def _database(location: str) -> contextlib.AbstractContextManager[object]:
    url = database_url(location)
    if url.get_backend_name() == "postgresql":
        return ServedDatabase(location)
    if url.get_backend_name() != "sqlite":
        return contextlib.nullcontext()
    file = Path(str(url.database)).resolve()
    refusal = (
        f"is using the database {file}; stop it, or give this server another file with --database"
    )
    return _locked(file.parent, f"{file.name}.{_NAME}", refusal)


@contextmanager
def _locked(folder: Path, name: str, refusal: str) -> Iterator[None]:
    try:
        import fcntl
    except ImportError:
        yield
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = os.open(folder / name, os.O_RDWR | os.O_CREAT, 0o600)
    except OSError:
        # An unwritable folder is reported by the code that needs to write there.
        yield
        return
    try:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(f"{_holder(os.pread(file, 20, 0))} {refusal}") from None
        except OSError:
            # Some network file systems have no locks.
            pass
        with contextlib.suppress(OSError):
            os.ftruncate(file, 0)
            os.pwrite(file, f"{os.getpid()}\n".encode(), 0)
        yield
    finally:
        os.close(file)


def _holder(written: bytes) -> str:
    pid = written.strip().decode(errors="replace")
    return f"another server (process {pid})" if pid.isdigit() else "another server"
