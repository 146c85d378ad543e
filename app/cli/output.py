"""Result files, written so that an interrupted run never destroys an earlier result."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from observer.errors import InputError


@contextmanager
def whole_file(path: Path) -> Iterator[IO[str]]:
    """Write text beside ``path`` and move it into place if the block succeeds.

    If the block fails, an earlier file stays unchanged and the text written so far is kept beside
    it, with ``.part`` added to the name.

    Raises:
        InputError: the folder does not exist, cannot be written or has no space left.
    """
    part = path.with_name(path.name + ".part")
    try:
        with part.open("w", encoding="utf-8") as file:
            yield file
        os.replace(part, path)
    except OSError as error:
        raise InputError(
            f"cannot write {path}: {error.strerror or error}; name a file in an existing, writable "
            "folder with enough space"
        ) from None
