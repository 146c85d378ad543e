"""Files and folders that are written completely or not at all."""

from __future__ import annotations

import contextlib
import errno
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

# No space, quota exceeded, file size limit: errors in writing that only more space helps.
NO_SPACE = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})


@contextlib.contextmanager
def whole_file(
    path: Path, *, private: bool = False, durable: bool = False, keep_unfinished: bool = False
) -> Iterator[Path]:
    """Provide a path to write to; its file or folder replaces ``path`` when the block ends.

    If the block fails, what it wrote is deleted and an earlier file at ``path`` stays unchanged.
    Readers and concurrent writers never find an incomplete file. The provided path has the same
    name, from which some writers derive the format, and is in a temporary folder beside ``path``.

    Args:
        private: create the file before the block, readable by its owner only (mode 0600).
        durable: return only when the file is on the disk, so that it survives a power failure.
        keep_unfinished: for long work by one writer: provide ``path`` with ``.part`` added to the
            name, and leave that file if the block fails or the process is killed.

    Raises:
        OSError: the folder cannot be written, or the file cannot be moved into place.
    """
    if not path.name:
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    with contextlib.ExitStack() as stack:
        part = path.with_name(f"{path.name}.part")
        if not keep_unfinished:
            part = Path(stack.enter_context(_folder_beside(path)), path.name)
        if private:
            os.close(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600))
        yield part
        if durable:
            _flush(part)
        os.replace(part, path)
        if durable:
            # Some file systems cannot flush folders; the file is in place already.
            with contextlib.suppress(OSError):
                _flush(path.parent)


def _folder_beside(path: Path) -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(
        dir=path.parent, prefix=f".{path.name}.", suffix=".part", ignore_cleanup_errors=True
    )


def _flush(path: Path) -> None:
    """Wait until the content of a file or folder is on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
