"""SQLAlchemy engines for a file or a URL, with the settings that each kind of database needs."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from sqlalchemy import URL, Connection, Engine, create_engine, event, make_url
from sqlalchemy.exc import ArgumentError

from app.storage.errors import StorageError
from observer.extras import package_missing, pip_install

_written_json = partial(json.dumps, allow_nan=False, ensure_ascii=False)
# Name of our connections in PostgreSQL's pg_stat_activity.
APPLICATION = "dynamic-observer"
# How long a call waits for another one's lock.
BUSY_TIMEOUT_S = 5.0
_POSTGRESQL = ("postgresql", "postgres", "postgresql+psycopg")
# Time until a lost server is noticed, even during a request.
_SILENCE_S = 10
# TCP keepalive on either side: idle seconds, interval in seconds, count.
_KEEPALIVES = {"idle": _SILENCE_S // 2, "interval": 2, "count": 3}


def database_url(location: str | Path) -> URL:
    """Convert the location that ``Storage`` takes to a URL.

    Raises:
        StorageError: it is not the URL of a supported database, or its driver is missing.
    """
    text = str(location)
    if "://" not in text:
        if text == ":memory:":
            raise StorageError("the storage needs a file or a database URL, not :memory:")
        return URL.create("sqlite", database=str(Path(text).expanduser().absolute()))
    try:
        url = make_url(text)
        if url.drivername in _POSTGRESQL:
            url = url.set(drivername="postgresql+psycopg")
        url.get_dialect().import_dbapi()
    except (ArgumentError, ValueError) as error:
        raise StorageError(
            "the database URL is not valid; it must look like sqlite:////folder/file.sqlite or "
            "postgresql://user:password@host/database"
        ) from error
    except ImportError as error:
        raise StorageError(_missing(url, error)) from error
    if url.get_backend_name() == "sqlite" and url.database in (None, "", ":memory:"):
        raise StorageError(
            "a database in memory cannot be shared by threads; "
            "name a file, as in sqlite:////folder/file.sqlite"
        )
    return url


def _missing(url: URL, error: ImportError) -> str:
    if url.get_backend_name() == "postgresql":
        return package_missing("a PostgreSQL database", "postgres", "psycopg[binary]")
    return (
        f"databases of the kind {url.drivername} need the Python package {error.name}; "
        f"install it with: {pip_install(str(error.name))}"
    )


def make_engine(url: URL, busy_timeout_s: float = BUSY_TIMEOUT_S) -> Engine:
    """Create an engine whose writers begin with the option ``writes``.

    Args:
        busy_timeout_s: how long a statement waits for a lock, and a thread for a connection.
    """
    options: dict[str, Any] = {
        "json_serializer": _written_json,
        "json_deserializer": _read_json,
        "pool_timeout": busy_timeout_s,
    }
    if url.get_backend_name() == "postgresql":
        options["connect_args"] = _postgresql_arguments(url, busy_timeout_s)
    if url.get_backend_name() != "sqlite":
        # Tested before each use: the server may have restarted meanwhile.
        return create_engine(url, pool_pre_ping=True, **options)
    engine = create_engine(url, connect_args={"timeout": busy_timeout_s}, **options)
    event.listen(engine, "connect", _on_sqlite_connect)
    event.listen(engine, "begin", _on_sqlite_begin)
    return engine


@contextmanager
def open_engine(
    location: str | Path | URL, busy_timeout_s: float = BUSY_TIMEOUT_S
) -> Iterator[Engine]:
    """Yield an engine as ``make_engine`` makes it, disposed of after the block."""
    url = location if isinstance(location, URL) else database_url(location)
    engine = make_engine(url, busy_timeout_s)
    try:
        yield engine
    finally:
        engine.dispose()


def _postgresql_arguments(url: URL, busy_timeout_s: float) -> dict[str, Any]:
    """Return the connection arguments; those in the URL take precedence."""
    waits_ms = max(1, round(1000 * busy_timeout_s))
    of_session = {
        "lock_timeout": waits_ms,
        "client_encoding": "UTF8",
        # The server drops a dead client as soon as a client drops a dead server: otherwise the
        # locks of a dead client would keep the next one from starting.
        **{f"tcp_keepalives_{name}": value for name, value in _KEEPALIVES.items()},
    }
    # https://www.postgresql.org/docs/current/libpq-connect.html#LIBPQ-PARAMKEYWORDS
    arguments = {
        "application_name": APPLICATION,
        "connect_timeout": max(2, round(busy_timeout_s)),
        **{f"keepalives_{name}": value for name, value in _KEEPALIVES.items()},
        "tcp_user_timeout": 1000 * _SILENCE_S,
        "options": " ".join(f"-c {name}={value}" for name, value in of_session.items()),
    }
    return {name: value for name, value in arguments.items() if name not in url.query}


def use_write_ahead_log(engine: Engine) -> None:
    """Set the mode of the file, not of the connection: once, after the file is known to be ours."""
    with closing(engine.raw_connection()) as connection:
        connection.cursor().execute("PRAGMA journal_mode=WAL")


def _read_json(text: str | bytes) -> Any:
    """Return a stored value, or its text as it stands if it was damaged by hand.

    An error here would keep all rows of a query from being read. No table stores plain text here,
    so each one recognises the damage and says what it does without the value.
    """
    try:
        value = json.loads(text)
        # What cannot be written could not be sent to anybody either.
        _written_json(value).encode()
    except (ValueError, RecursionError):
        return text if isinstance(text, str) else repr(text)
    return value


def _read_text(content: bytes) -> str:
    """Return stored text, without invalid UTF-8, which would keep all rows from being read."""
    return content.decode("utf-8", "replace")


def _on_sqlite_connect(connection: Any, _record: object) -> None:
    connection.text_factory = _read_text
    # We send BEGIN ourselves: the driver's own leaves DDL outside transactions.
    connection.isolation_level = None
    cursor = connection.cursor()
    # With a write-ahead log, NORMAL survives the process's death at any moment without loss; a
    # power cut may lose the last transactions but never damages the file.
    cursor.execute("PRAGMA synchronous=NORMAL")
    cursor.execute("PRAGMA foreign_keys=ON")
    cursor.close()


def _on_sqlite_begin(connection: Connection) -> None:
    # A writer takes the lock at once: a reader that upgrades to a writer is refused without waiting
    # if somebody else wrote in between.
    writes = connection.get_execution_options().get("writes", False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")
