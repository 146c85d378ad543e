"""Files in the data folder: written atomically, failures as the server's own errors."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

from app.server.errors import FieldError
from app.storage import StorageFull
from observer.whole_files import NO_SPACE, whole_file


def write_whole(path: Path, text: str) -> None:
    """Write a file atomically and hide it from other users (mode 0600).

    Raises:
        StorageFull: no space is left. FieldError: the file cannot be written; the old one stays.
    """
    with storage_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path, private=True, durable=True) as part:
            part.write_text(text, encoding="utf-8")


@contextlib.contextmanager
def storage_errors(path: Path) -> Iterator[None]:
    """Convert errors in writing a file or folder to the server's own errors.

    Raises:
        StorageFull: no space is left. FieldError: it cannot be written.
    """
    try:
        yield
    except OSError as error:
        if error.errno in NO_SPACE:
            raise StorageFull(f"no space is left to write {path}; free some disk space") from error
        raise FieldError(
            ("body",), f"{path} cannot be written: {error.strerror or error}"
        ) from error
