"""Writing a result file so that an interrupted run never destroys an earlier result."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from observer.errors import InputError


@contextmanager
def whole_file(path: Path) -> Iterator[IO[str]]:
    """Write text beside ``path`` and put it in place when the block ends well.

    When it does not, an earlier file stays as it was and what was written so far is kept beside
    it under the name with ``.part`` added.

    Raises:
        InputError: the folder does not exist or cannot be written.
    """
    part = path.with_name(path.name + ".part")
    try:
        file = part.open("w", encoding="utf-8")
    except OSError as error:
        raise InputError(
            f"cannot write {path}: {error.strerror}; name a file in a folder that exists and "
            f"may be written"
        ) from None
    with file:
        yield file
    os.replace(part, path)
