"""Errors of the storage, and their mapping from the codes of database drivers."""

from __future__ import annotations

import errno
import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager

from sqlalchemy.exc import SQLAlchemyError

from observer.errors import DynamicObserverError


class StorageError(DynamicObserverError):
    """Failure to use the database as requested; the message says what would help."""


class StorageBusy(StorageError):
    """Database held by another program; the same call may succeed later."""


class StorageUnreachable(StorageBusy):
    """Database server without an answer; it may answer later."""


class StorageOutOfFiles(StorageBusy):
    """Process that may open no further file; it may once others are closed."""


class StorageFull(StorageError):
    """Full disk (or quota); the failed call wrote nothing."""


class StorageReadOnly(StorageError):
    """File that this process may not write: its permissions, or a read-only disk."""


class StorageCorrupt(StorageError):
    """Damage to the file while it was open; the next start moves it aside."""


class StorageUnreadable(StorageError):
    """Record whose values were damaged by hand; the other records are readable."""


class StorageMissing(StorageError):
    """Missing record that the call names or refers to."""


class StorageExists(StorageError):
    """Name that another record has already."""


# PostgreSQL's codes: https://www.postgresql.org/docs/current/errcodes-appendix.html
_BY_SQLSTATE: dict[str, type[StorageError]] = {
    "53100": StorageFull,
    "53300": StorageBusy,
    "55P03": StorageBusy,
    "57014": StorageBusy,
    "57P01": StorageUnreachable,
    "57P02": StorageUnreachable,
    "57P03": StorageUnreachable,
    "40001": StorageBusy,
    "40P01": StorageBusy,
    "23503": StorageMissing,
    "23505": StorageExists,
}
_BY_SQLITE_EXTENDED: dict[int, type[StorageError]] = {
    sqlite3.SQLITE_CONSTRAINT_FOREIGNKEY: StorageMissing,
    sqlite3.SQLITE_CONSTRAINT_PRIMARYKEY: StorageExists,
    sqlite3.SQLITE_CONSTRAINT_UNIQUE: StorageExists,
}
_BY_SQLITE_PRIMARY: dict[int, type[StorageError]] = {
    sqlite3.SQLITE_BUSY: StorageBusy,
    sqlite3.SQLITE_LOCKED: StorageBusy,
    sqlite3.SQLITE_FULL: StorageFull,
    sqlite3.SQLITE_CANTOPEN: StorageReadOnly,
    sqlite3.SQLITE_READONLY: StorageReadOnly,
    sqlite3.SQLITE_CORRUPT: StorageCorrupt,
    sqlite3.SQLITE_NOTADB: StorageCorrupt,
}
_SENTENCES: dict[type[StorageError], str] = {
    StorageUnreachable: (
        "the database {where} cannot be reached ({cause}); check that its server is running"
    ),
    StorageBusy: "the database {where} is locked by another program; close it or try again",
    StorageOutOfFiles: (
        "the database {where} cannot be opened because the server has too many open files; close "
        "some of its pages, or raise the limit (ulimit -n) and restart it"
    ),
    StorageFull: "no space is left to write the database {where}; free some disk space",
    StorageReadOnly: (
        "the database {where} cannot be written ({cause}); check the permissions of its folder and "
        "that its disk is not read-only, or choose another folder"
    ),
    StorageCorrupt: (
        "the database {where} is damaged; restart the server to move it aside and create a new one"
    ),
    StorageMissing: "a record refers to another one that is missing in the database {where}",
    StorageExists: "a record with this name or id already exists in the database {where}",
}


def storage_error(cause: BaseException | None, where: str) -> StorageError:
    """Convert a driver's error to the storage's own; ``where`` names the database for people."""
    kind = _kind(cause)
    if kind is None:
        return StorageError(f"the database {where} rejected the request: {_said(cause)}")
    return kind(_SENTENCES[kind].format(where=where, cause=_said(cause)))


@contextmanager
def translated(where: str) -> Iterator[None]:
    """Raise errors of SQLAlchemy in the block as ``storage_error`` gives them."""
    try:
        yield
    except SQLAlchemyError as error:
        raise storage_error(getattr(error, "orig", None) or error, where) from error


def _said(cause: BaseException | None) -> str:
    """Return the message on one line, without the labels of drivers that write several."""
    return " ".join(str(cause).removesuffix("\n").split())


def _kind(cause: BaseException | None) -> type[StorageError] | None:
    code = getattr(cause, "sqlite_errorcode", None)
    if isinstance(code, int):
        if code & 0xFF == sqlite3.SQLITE_CANTOPEN and _is_out_of_files():
            return StorageOutOfFiles
        # The low byte of an extended result code is its primary code.
        return _BY_SQLITE_EXTENDED.get(code) or _BY_SQLITE_PRIMARY.get(code & 0xFF)
    state = getattr(cause, "sqlstate", None)
    if isinstance(state, str):
        # Class 08 contains connection exceptions.
        return StorageUnreachable if state.startswith("08") else _BY_SQLSTATE.get(state)
    # psycopg has no code for failures before a server answers, or after it is gone.
    return StorageUnreachable if type(cause).__name__ == "OperationalError" else None


def _is_out_of_files() -> bool:
    """Return whether no further file can be opened, which SQLite tells like a missing folder."""
    try:
        os.close(os.open(os.devnull, os.O_RDONLY))
    except OSError as error:
        return error.errno in (errno.EMFILE, errno.ENFILE)
    return False
