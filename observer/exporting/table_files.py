"""Tables as files: CSV for every tool, Parquet for large tables."""

from __future__ import annotations

import csv
from itertools import islice
from typing import IO, Any

from observer.exporting.errors import ExportError
from observer.exporting.tables import Table
from observer.extras import package_missing
from observer.recording.reader import Recording

# Rows of a Parquet file that are written per batch.
_BATCH = 65_536


def write_csv(table: Table, recording: Recording, file: IO[str]) -> int:
    """Write a table with its header; numbers are written without loss of digits.

    Args:
        file: opened with ``newline=""``.

    Returns:
        Number of rows.
    """
    writer = csv.DictWriter(file, table.names, lineterminator="\n")
    writer.writeheader()
    count = 0
    for row in table.rows(recording):
        writer.writerow(row)
        count += 1
    return count


def write_parquet(table: Table, recording: Recording, file: IO[bytes]) -> int:
    """Write a table as Parquet, with each column's help as metadata; return the number of rows.

    Raises:
        ExportError: pyarrow is not installed.
    """
    pyarrow, parquet = _pyarrow()
    kinds = {"int": pyarrow.int64(), "float": pyarrow.float64(), "text": pyarrow.string()}
    schema = pyarrow.schema(
        [
            pyarrow.field(column.name, kinds[column.kind], metadata={"help": column.help})
            for column in table.columns
        ]
    )
    count, rows = 0, table.rows(recording)
    with parquet.ParquetWriter(file, schema) as writer:
        while batch := list(islice(rows, _BATCH)):
            writer.write_table(pyarrow.Table.from_pylist(batch, schema=schema))
            count += len(batch)
    return count


def check_parquet() -> None:
    """Check early that Parquet can be written.

    Raises:
        ExportError: it cannot.
    """
    _pyarrow()


def _pyarrow() -> tuple[Any, Any]:
    try:
        import pyarrow  # type: ignore[import-untyped]
        from pyarrow import parquet
    except ImportError:
        raise ExportError(package_missing("a Parquet file", "parquet", "pyarrow")) from None
    return pyarrow, parquet
