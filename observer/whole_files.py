"""Files that are written completely or not at all."""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Provide a path beside ``path`` to write to; its file replaces ``path`` when the block ends.

    If the block fails, its file is deleted and an earlier one at ``path`` stays unchanged. Readers
    and concurrent writers never find an incomplete file.

    Raises:
        OSError: the file cannot be moved into place.
    """
    part = path.with_name(f".{path.name}.{secrets.token_hex(4)}.part")
    try:
        yield part
        os.replace(part, path)
    except BaseException:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
        raise
