"""Output that is moved into place only when complete, and replaces nothing unasked."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from observer.exporting.errors import ExportError


@contextmanager
def whole_output(path: Path, *, overwrite: bool = False) -> Iterator[Path]:
    """Provide a path of the same name in a temporary folder, for a file or folder.

    When the block ends, the output is moved to ``path``. If it ends with an error, the output is
    deleted and anything already there stays.

    Args:
        overwrite: replace existing output.

    Raises:
        ExportError: the path exists, or its folder does not exist or cannot be written.
    """
    if os.path.lexists(path) and not overwrite:
        raise ExportError(f"{path} exists; name another output, or add --overwrite to replace it")
    if path.is_dir() and any(path.iterdir()) and not (path / "metadata.yaml").is_file():
        raise ExportError(f"{path} is a folder but not a bag, so it is not replaced")
    if not path.parent.is_dir() or not os.access(path.parent, os.W_OK):
        raise ExportError(f"cannot write {path}; name an output in an existing, writable folder")
    beside = path.with_name(f".{path.name}.part")
    _remove(beside)
    try:
        beside.mkdir()
        yield beside / path.name
        if path.is_dir():
            _remove(path)
        os.replace(beside / path.name, path)
    except OSError as error:
        raise ExportError(f"cannot write {path}: {error.strerror or error}") from None
    finally:
        _remove(beside)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)
