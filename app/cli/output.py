"""Result files, written so that an interrupted run never destroys an earlier result."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from observer.errors import InputError

# What writing to an open file fails with when there is no room.
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@contextmanager
def whole_file(path: Path) -> Iterator[IO[str]]:
    """Write text beside ``path`` and move it into place if the block succeeds.

    If the block fails, an earlier file stays unchanged and the text written so far is kept beside
    it, with ``.part`` added to the name.

    Raises:
        InputError: the folder does not exist, cannot be written or has no space left.
    """
    part = path.with_name(path.name + ".part")
    with refusing(path):
        file = part.open("w", encoding="utf-8")
    try:
        with file:
            yield file
    except OSError as error:
        # Other errors are not the file's: the block may also read from a source.
        if error.errno not in _NO_ROOM:
            raise
        raise _cannot_write(path, error) from None
    with refusing(path):
        os.replace(part, path)


@contextmanager
def refusing(path: Path) -> Iterator[None]:
    """Turn an ``OSError`` of the block, which writes ``path``, into an ``InputError``."""
    try:
        yield
    except OSError as error:
        raise _cannot_write(path, error) from None


def _cannot_write(path: Path, error: OSError) -> InputError:
    return InputError(
        f"cannot write {path}: {error.strerror or error}; name a file in an existing, writable "
        "folder with enough space"
    )
