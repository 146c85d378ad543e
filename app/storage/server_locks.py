"""Locks that a database server keeps beside the tables, to exclude other servers.

https://www.postgresql.org/docs/current/explicit-locking.html#ADVISORY-LOCKS; they belong to one
database and end with the transaction or the connection that took them.
"""

from __future__ import annotations

import os
import socket
import threading
import time
from typing import Self

import structlog
from sqlalchemy import Connection, bindparam, func, select, text
from sqlalchemy.exc import DBAPIError, SQLAlchemyError

from app.storage.engines import APPLICATION, database_url, make_engine
from app.storage.errors import StorageError, storage_error

log = structlog.get_logger(__name__)

# Arbitrary numbers that no other program uses; below 2^32, so that pg_locks has them in objid.
_WHOLE = 0x64796E62
_SERVED = 0x64796E63
# Time for which PostgreSQL may still see a server that was killed.
_LETS_GO_S = 2.0
_LOOK_S = 5.0
# Limit of waiting at shutdown for a database server that does not answer.
_PATIENCE_S = 1.0
_HOLDER = text(
    "SELECT application_name FROM pg_stat_activity JOIN pg_locks USING (pid) WHERE"
    " locktype = 'advisory' AND classid = 0 AND objid = :key AND granted"
    " AND database = (SELECT oid FROM pg_database WHERE datname = current_database())"
).bindparams(bindparam("key", _SERVED))
# The longest name that PostgreSQL keeps.
_LONGEST_NAME = 63


def lock_whole(connection: Connection) -> None:
    """Keep other servers from migrating or replacing this database until the end of the
    transaction.
    """
    if connection.dialect.name == "postgresql":
        connection.execute(select(func.pg_advisory_xact_lock(_WHOLE)))


class ServedDatabase:
    """Exclusive lock of a server on a database, held and monitored on a connection of its own.

    A restarted database server has lost the lock; it is taken again within seconds.

    Args:
        location: the URL of a PostgreSQL database.

    Raises:
        StorageError: the URL is invalid, or its driver is missing.
    """

    def __init__(self, location: str, *, look_s: float = _LOOK_S) -> None:
        url = database_url(location)
        self._where = url.render_as_string(hide_password=True)
        name = f"{APPLICATION} {os.getpid()} on {socket.gethostname()}"[:_LONGEST_NAME]
        self._engine = make_engine(url.update_query_dict({"application_name": name}))
        self._look_s = look_s
        self._connection: Connection | None = None
        self._warned = False
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._look_after, name="database lock", daemon=True)

    def __enter__(self) -> Self:
        """Take the lock.

        Raises:
            StorageError: another server has it, or the database server cannot be asked.
        """
        deadline = time.monotonic() + _LETS_GO_S
        try:
            while not self._take():
                if time.monotonic() > deadline:
                    raise StorageError(self._refusal())
                time.sleep(0.1)
        except DBAPIError as error:
            self._let_go()
            raise storage_error(error.orig, self._where) from error
        except BaseException:
            self._let_go()
            raise
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join(_PATIENCE_S)
        # A thread that waits for a lost server ends with the process, and so does the lock.
        if not self._thread.is_alive():
            self._let_go()

    def _take(self) -> bool:
        if self._connection is None:
            options = {"isolation_level": "AUTOCOMMIT"}
            self._connection = self._engine.connect().execution_options(**options)
        # A connection that has the lock gets it again.
        return bool(self._connection.scalar(select(func.pg_try_advisory_lock(_SERVED))))

    def _let_go(self) -> None:
        connection, self._connection = self._connection, None
        try:
            if connection is not None:
                # Not returned to the pool: the lock belongs to the connection.
                connection.invalidate()
                connection.close()
        except SQLAlchemyError as error:
            log.warning("database_lock_not_closed", reason=str(error))
        self._engine.dispose()

    def _refusal(self) -> str:
        assert self._connection is not None
        name = str(self._connection.scalar(_HOLDER) or "")
        who = name.removeprefix(APPLICATION).strip()
        return (
            f"another server{f' (process {who})' if who else ''} is using the database "
            f"{self._where}; stop it, or give this server its own database with --database"
        )

    def _look_after(self) -> None:
        while not self._ended.wait(self._look_s):
            try:
                self._look()
            except DBAPIError:
                # The database server is away; the next look connects to it again.
                self._let_go()
            except Exception:
                # Whatever is wrong, the lock must not stay lost unnoticed.
                log.exception("database_lock_check_failed")
                self._let_go()

    def _look(self) -> None:
        """Take the lock again if it was lost; warn once if another server has it."""
        if not self._take() and not self._warned:
            self._warned = True
            log.warning("database_served_by_another", refusal=self._refusal())
