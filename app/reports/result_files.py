"""Files with results, written completely or not at all."""

from __future__ import annotations

from pathlib import Path

from observer.errors import InputError
from observer.whole_files import whole_file


def write_file(path: Path, content: bytes) -> None:
    """Write a file completely or not at all.

    Raises:
        InputError: it cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as part:
            part.write_bytes(content)
    except OSError as error:
        raise InputError(
            f"cannot write {path}: {error.strerror}; name a file in a writable folder"
        ) from None
