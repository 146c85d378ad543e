"""Room that a recording needs on its disk."""

from __future__ import annotations

import shutil
from pathlib import Path

from observer.recording.errors import RecordingError


def free_bytes(path: Path) -> int:
    """Return the free bytes on the disk of a file."""
    return shutil.disk_usage(path.parent).free


def almost_full(path: Path, left: int, reserve: int) -> str:
    """Return the message for a disk with too little room for a recording."""
    return (
        f"the recording {path.name} cannot continue: only {left >> 20} MB are free on the disk and "
        f"{reserve >> 20} MB are reserved; free some space and start a new run"
    )


def make_room(path: Path, reserve_bytes: int) -> None:
    """Check that a file can be begun.

    Raises:
        RecordingError: the file cannot be begun, or the disk is almost full.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        left = free_bytes(path)
    except OSError as error:
        raise RecordingError.of(error, path.name) from None
    if left < reserve_bytes:
        raise RecordingError(almost_full(path, left, reserve_bytes), full=True)
