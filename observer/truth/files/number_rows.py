"""Fast reader of rows of numbers in a text file, with bounded memory; empty cells are NaN."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from observer.errors import TruthError
from observer.geometry import Float64Array
from observer.truth.files.text_lines import TextLines, has_decimal_comma

# Half a gigabyte, or 30 minutes of 50 bodies at 100 Hz.
_MOST_CELLS = 60_000_000
# Cells that are held as Python floats before they go into an array.
_CELLS_AT_ONCE = 250_000
_MOST_NAMES = 1000
_NAN = math.nan


class NumberRows:
    """Table of numbers as read.

    Attributes:
        count: number of rows. names: distinct texts of the name column, in order of appearance;
            that column's numbers are indices into it.
    """

    def __init__(
        self, file: TextLines, chunks: list[Float64Array], lines: list[int], names: list[str]
    ) -> None:
        self._file = file
        self._chunks = chunks
        self._lines = np.array(lines, dtype=np.int64)
        self.names = names
        self.count = len(lines)

    def columns(self, wanted: Sequence[int]) -> Float64Array:
        """Return columns (N, len(wanted)) as a new array."""
        return np.concatenate([chunk[:, wanted] for chunk in self._chunks])

    def column(self, wanted: int) -> Float64Array:
        """Return a column (N,) as a new array."""
        return self.columns([wanted])[:, 0]

    def refuse(
        self, wrong: NDArray[np.intp], why: str | Callable[[int], str], cell: int | None = None
    ) -> None:
        """Refuse the first of these rows, if there are any.

        Args:
            why: the reason, or a function that returns it for a row. cell: to be named, from 1.

        Raises:
            TruthError: one sentence naming the line, the cell and the reason.
        """
        if len(wrong):
            row = int(wrong[0])
            reason = why if isinstance(why, str) else why(row)
            raise TruthError(f"{self._file.where(int(self._lines[row]), cell)}: {reason}")


def read_numbers(
    lines: TextLines,
    labels: Sequence[str],
    *,
    separator: str | None,
    names_in: int | None = None,
    only: Sequence[int] | None = None,
    short: bool = False,
    sections: bool = False,
) -> NumberRows:
    """Read rows to the end of their table, one number for each label.

    Args:
        labels: what each cell is, for messages.
        separator: between cells; None for white space, in which case lines that start with # are
            skipped.
        names_in: the index of a column that holds names.
        only: indices of the columns that are used; None for all. Others may hold anything.
        short: rows may end early; missing cells are NaN.
        sections: an empty line ends the table; otherwise empty lines are skipped.

    Raises:
        TruthError: a cell is not a number, a row has too few or too many, or there are too many.
    """
    unused = () if only is None else tuple(sorted({*range(len(labels))} - {*only}))
    reader = _Reader(lines, labels, separator, names_in, unused, short)
    chunks: list[Float64Array] = []
    rows: list[list[float]] = []
    numbers: list[int] = []
    width = len(labels)
    at_once = max(1, _CELLS_AT_ONCE // width)
    while (line := lines.next()) is not None:
        if separator is None and (not line.strip() or line.lstrip().startswith("#")):
            continue
        if not line.strip(" \t,;"):
            if sections:
                break
            continue
        rows.append(reader.row(line))
        numbers.append(lines.number)
        if len(rows) == at_once:
            chunks.append(reader.chunk(rows, numbers))
            rows = []
            if len(numbers) * width > _MOST_CELLS:
                raise TruthError(
                    f"{lines.name}: there are more than {_MOST_CELLS} numbers; export a shorter "
                    "section, or fewer bodies"
                )
    if rows or not chunks:
        chunks.append(reader.chunk(rows, numbers))
    return NumberRows(lines, chunks, numbers, list(reader.names))


@dataclass(eq=False)
class _Reader:
    """Parser of rows; its arguments are those of ``read_numbers``."""

    lines: TextLines
    labels: Sequence[str]
    separator: str | None
    names_in: int | None
    unused: Sequence[int]
    short: bool
    names: dict[str, int] = field(default_factory=dict)

    def row(self, line: str) -> list[float]:
        """Parse a line into one number for each label."""
        quoted = '"' in line
        cells = cells_of(self.lines, line, self.separator) if quoted else line.split(self.separator)
        if self.names_in is not None and self.names_in < len(cells):
            cells[self.names_in] = self._name(cells[self.names_in])
        for column in self.unused:
            if column < len(cells):
                cells[column] = ""
        if has_decimal_comma(self.separator):
            cells = [cell.replace(",", ".") for cell in cells]
        try:
            # float() also accepts "1_000", which is surely an error in a table of measurements.
            row = [float(cell) if cell else _NAN for cell in cells]
            slow = any("_" in cell for cell in cells) if "_" in line else False
        except ValueError:
            slow = True
        if slow:
            row = [self._number(cell, index) for index, cell in enumerate(cells)]
        width = len(self.labels)
        if len(row) > width:
            if any(not math.isnan(value) for value in row[width:]):
                raise TruthError(
                    f"{self.lines.where()}: the row has {len(row)} cells, but the header has "
                    f"{width}"
                )
            del row[width:]
        elif len(row) < width:
            if not self.short:
                raise TruthError(
                    f"{self.lines.where()}: the row has only {len(row)} cells, but there must be "
                    f"{width}: {', '.join(self.labels)[:120]}"
                )
            row += [_NAN] * (width - len(row))
        return row

    def chunk(self, rows: list[list[float]], numbers: list[int]) -> Float64Array:
        """Return the latest rows as an array, checked to be finite or NaN."""
        values = np.array(rows, dtype=np.float64).reshape(len(rows), len(self.labels))
        wrong = np.isinf(values)
        if wrong.any():
            row, column = np.argwhere(wrong)[0].tolist()
            where = self.lines.where(numbers[len(numbers) - len(rows) + row], column + 1)
            raise TruthError(f"{where}: {self.labels[column]} must be a finite number")
        return values

    def _number(self, cell: str, index: int) -> float:
        text = cell.strip()
        try:
            return float(text.replace("_", "?")) if text else _NAN
        except ValueError:
            label = self.labels[index] if index < len(self.labels) else "beyond the header"
            raise TruthError(
                f"{self.lines.where(cell=index + 1)}: {label} must be a number, not {text[:40]!r}"
            ) from None

    def _name(self, cell: str) -> str:
        number = self.names.setdefault(cell.strip(), len(self.names))
        if number >= _MOST_NAMES:
            raise TruthError(
                f"{self.lines.where()}: there are more than {_MOST_NAMES} names of bodies"
            )
        return str(number)


def cells_of(lines: TextLines, line: str, separator: str | None) -> list[str]:
    """Split the line that was read last into cells, respecting quotation marks.

    Raises:
        TruthError: the line is not valid CSV.
    """
    if separator is None:
        return line.split()
    try:
        return next(csv.reader([line], delimiter=separator, strict=True), [])
    except csv.Error as error:
        raise TruthError(f"{lines.where()}: the line is not valid CSV: {error}") from None
