"""Copies of whole databases between kinds: from a server into an SQLite file, and back."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from sqlalchemy import (
    JSON,
    Connection,
    Engine,
    MetaData,
    Table,
    create_engine,
    event,
    func,
    insert,
    select,
    text,
)
from sqlalchemy.engine.interfaces import ReflectedColumn
from sqlalchemy.exc import SQLAlchemyError

from app.storage.errors import StorageError

_ROWS = 2000


def copy_tables(engine: Engine, file: Path) -> None:
    """Copy a server's tables, at any revision, into a new SQLite file.

    The copy is a snapshot of one moment, even while others write.

    Raises:
        StorageError: the file cannot be written; nothing of it is left.
        SQLAlchemyError: the server cannot be read.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    target = create_engine(f"sqlite:///{file}")
    try:
        with engine.connect().execution_options(isolation_level="REPEATABLE READ") as source:
            tables = _tables(source)
            with target.begin() as sink:
                tables.create_all(sink)
                _copy(source, sink, tables.sorted_tables)
    except SQLAlchemyError as error:
        file.unlink(missing_ok=True)
        if getattr(getattr(error, "orig", None), "sqlite_errorcode", None) is None:
            raise
        raise StorageError(
            f"the database cannot be copied to {file} ({error.__cause__}); free some disk space or "
            f"make the folder writable"
        ) from error
    finally:
        target.dispose()


def replace_tables(source: Engine, connection: Connection) -> None:
    """Replace all rows by those of the source, within the connection's transaction.

    Both databases must have the same revision.
    """
    tables = _tables(connection)
    for table in reversed(tables.sorted_tables):
        connection.execute(table.delete())
    with source.connect() as opened:
        _copy(opened, connection, tables.sorted_tables)
    if connection.dialect.name == "postgresql":
        for table in tables.sorted_tables:
            _count_on(connection, table)


def _copy(source: Connection, sink: Connection, tables: Iterable[Table]) -> None:
    for table in tables:
        rows = source.execution_options(yield_per=_ROWS).execute(select(table)).mappings()
        for part in rows.partitions(_ROWS):
            sink.execute(insert(table), [dict(row) for row in part])


def _count_on(connection: Connection, table: Table) -> None:
    """Advance the sequence of row numbers; inserting rows with given numbers did not."""
    for column in table.primary_key:
        name = connection.scalar(select(func.pg_get_serial_sequence(table.name, column.name)))
        if name is not None:
            last = connection.scalar(select(func.max(column)))
            statement = text("SELECT setval(:name, :last, :used)")
            values = {"name": name, "last": last or 1, "used": last is not None}
            connection.execute(statement, values)


def _tables(connection: Connection) -> MetaData:
    tables = MetaData()
    event.listen(tables, "column_reflect", _plain)
    tables.reflect(connection)
    return tables


def _plain(_inspector: object, _table: Table, column: ReflectedColumn) -> None:
    # SQLite has no use for a server's sequences and casts.
    column["default"] = None
    if isinstance(column["type"], JSON):
        column["type"].none_as_null = True
