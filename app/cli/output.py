"""Result files, written so that an interrupted run never destroys an earlier result."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from observer.errors import InputError
from observer.whole_files import NO_SPACE, whole_file


@contextmanager
def whole_text(path: Path) -> Iterator[IO[str]]:
    """Open a text file that replaces ``path`` if the block succeeds.

    If the block fails, an earlier file stays unchanged and the text written so far is kept beside
    it, with ``.part`` added to the name.

    Raises:
        InputError: the folder does not exist, cannot be written or has no space left.
    """
    with refusing(path), whole_file(path, keep_unfinished=True) as part:
        file = part.open("w", encoding="utf-8")
        try:
            with file:
                yield file
        except OSError as error:
            if error.errno in NO_SPACE:
                # Writing to an open file names no file.
                error.filename = str(part)
            raise


@contextmanager
def refusing(path: Path) -> Iterator[None]:
    """Turn an ``OSError`` that names ``path`` or its ``.part`` into an ``InputError``.

    Others are not the file's: the block may also read from a source.
    """
    try:
        yield
    except OSError as error:
        names = (str(error.filename), str(error.filename2))
        if not {str(path), f"{path}.part"}.intersection(names):
            raise
        raise InputError(
            f"cannot write {path}: {error.strerror or error}; name a file in an existing, writable "
            "folder with enough space"
        ) from None
