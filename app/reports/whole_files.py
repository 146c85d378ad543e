"""Writing of result files such that nobody ever finds an incomplete one."""

from __future__ import annotations

import os
from pathlib import Path

from observer.errors import InputError


def write_file(path: Path, content: bytes) -> None:
    """Write a file completely or not at all.

    Raises:
        InputError: it cannot be written.
    """
    part = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_bytes(content)
        os.replace(part, path)
    except OSError as error:
        raise InputError(
            f"cannot write {path}: {error.strerror}; name a file in a writable folder"
        ) from None
