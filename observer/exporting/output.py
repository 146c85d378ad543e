"""Output that is moved into place only when complete, and replaces nothing unasked."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from observer.exporting.errors import ExportError
from observer.whole_files import whole_file


@contextmanager
def whole_output(path: Path, *, overwrite: bool = False) -> Iterator[Path]:
    """Provide a path as ``whole_file`` does, for a file or a bag, which is a folder.

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
    try:
        with whole_file(path) as part:
            yield part
            _remove_bag(path)
    except OSError as error:
        raise ExportError(f"cannot write {path}: {error.strerror or error}") from None


def _remove_bag(path: Path) -> None:
    """Remove an earlier bag, which, unlike a file, cannot be replaced by renaming."""
    if path.is_symlink():
        path.unlink()
    elif path.is_dir():
        shutil.rmtree(path)
