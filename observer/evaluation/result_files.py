"""Result files of evaluations, written completely or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from observer.errors import InputError
from observer.whole_files import whole_file


@contextmanager
def whole_result(path: Path, remark: str = "") -> Iterator[Path]:
    """Provide a path to write to as ``whole_file`` does.

    Args:
        remark: what to add to the error's sentence.

    Raises:
        InputError: the file cannot be written.
    """
    try:
        with whole_file(path) as part:
            yield part
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}{remark}") from None
