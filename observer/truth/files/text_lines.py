"""Reader of a text file line by line, numbered for messages, with bounded memory."""

from __future__ import annotations

import codecs
import io
from typing import BinaryIO

from observer.errors import TruthError
from observer.text_files import WIDE_MARKS
from observer.truth.files.known import understood_in_words

# Enough for tens of thousands of markers in a row.
_MOST_CHARACTERS = 1 << 20
# Number of bytes that decide between UTF-8 and an older encoding.
_LOOK = 1 << 16


class TextLines:
    """Lines without their ends, with look-ahead.

    Text is UTF-8 with or without a byte order mark, or UTF-16 with one; otherwise it is read as
    Windows' Western European code page, in which Nexus writes names.

    Attributes:
        name: the file's, for messages. number: of the line ``next`` returned last, from 1.
        is_unicode: True if the file's beginning is UTF-8 or UTF-16.

    Raises:
        TruthError: it is not text, or a line is longer than a million characters.
    """

    def __init__(self, file: BinaryIO, name: str) -> None:
        self.name = name
        self.number = 0
        head = file.read(_LOOK)
        file.seek(0)
        is_wide = head.startswith(WIDE_MARKS)
        if b"\0" in head and not is_wide:
            raise TruthError(f"{name}: the file is neither text nor C3D; {understood_in_words()}")
        self.is_unicode = is_wide or _is_utf8(head)
        encoding = "utf-16" if is_wide else "utf-8-sig" if self.is_unicode else "cp1252"
        self._file = io.TextIOWrapper(file, encoding=encoding, errors="replace")
        self._ahead: list[str] = []

    def next(self) -> str | None:
        """Return the next line, None at the end."""
        line = self._ahead.pop(0) if self._ahead else self._read(self.number + 1)
        if line is not None:
            self.number += 1
        return line

    def peek(self, count: int) -> list[str]:
        """Return the next ``count`` lines, fewer at the end, without consuming them."""
        while len(self._ahead) < count:
            line = self._read(self.number + len(self._ahead) + 1)
            if line is None:
                break
            self._ahead.append(line)
        return self._ahead[:count]

    def where(self, number: int | None = None, cell: int | None = None) -> str:
        """Name a line, the last one by default, and a cell of it from 1, for messages."""
        line = f"{self.name} line {self.number if number is None else number}"
        return line if cell is None else f"{line} cell {cell}"

    def _read(self, number: int) -> str | None:
        line = self._file.readline(_MOST_CHARACTERS + 1)
        if len(line) > _MOST_CHARACTERS:
            raise TruthError(
                f"{self.name} line {number}: the line is longer than {_MOST_CHARACTERS} "
                "characters, so this is not a motion-capture table"
            )
        return line.rstrip("\n") if line else None


def separator_of(text: str) -> str:
    """Return the cell separator: spreadsheets of some countries write semicolons, others tabs."""
    return max(",;\t", key=text.count)


def has_decimal_comma(separator: str | None) -> bool:
    """Return whether a comma is the decimal point between such cell separators."""
    return separator in (";", "\t")


def _is_utf8(head: bytes) -> bool:
    try:
        # The end of the head may split a character.
        codecs.getincrementaldecoder("utf-8")().decode(head, final=False)
    except UnicodeDecodeError:
        return False
    return True
