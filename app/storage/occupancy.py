"""One server for one data folder: two would take each other's runs for interrupted ones."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from observer.errors import InputError

_NAME = "server.lock"


@contextmanager
def occupied(folder: Path) -> Iterator[None]:
    """Hold a data folder as long as the context; the system lets go of it with the process.

    Where the system or the folder's file system knows no locks, nothing is held.

    Raises:
        InputError: another server holds it.
    """
    try:
        import fcntl
    except ImportError:
        yield
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = os.open(folder / _NAME, os.O_RDWR | os.O_CREAT, 0o600)
    except OSError:
        # What cannot be written is told by whoever needs to write there.
        yield
        return
    try:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(_refusal(folder, os.pread(file, 20, 0))) from None
        except OSError:
            # As on some network file systems.
            pass
        with contextlib.suppress(OSError):
            os.ftruncate(file, 0)
            os.pwrite(file, f"{os.getpid()}\n".encode(), 0)
        yield
    finally:
        os.close(file)


def _refusal(folder: Path, holder: bytes) -> str:
    pid = holder.strip().decode(errors="replace")
    who = f"another server (process {pid})" if pid.isdigit() else "another server"
    return (
        f"{who} keeps its runs in {folder}; stop it, or give this one a folder of its own with "
        f"--data"
    )
