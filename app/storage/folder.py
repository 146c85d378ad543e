"""The data folder: files beside the database, and the disk space that they take."""

from __future__ import annotations

import os
import re
import secrets
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from app.storage.errors import StorageError, StorageMissing
from observer.recording.run_folder import RECORDING, RUNS

TRUTHS = "truths"
# Folder of saved clips that belong to no run, and its former name, which is only read.
CLIPS = "clips"
FORMER_CLIPS = "rings"
# A run's folder during deletion; remains of a crash are deleted next time.
_LEAVING = ".deleted-"
_ID = re.compile(r"[0-9A-Za-z][0-9A-Za-z_-]{0,99}")
_BLOCK = 512


@dataclass(frozen=True)
class DiskUse:
    """Disk space in bytes: ``total`` of all data, and ``free`` for more."""

    total: int
    free: int


class DataFolder:
    """Data folder.

    Args:
        path: the folder; it need not exist.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def run(self, run_id: str) -> Path:
        """Return the folder of a run's files: ``recording.mcap`` and whatever belongs to it.

        Raises:
            StorageMissing: no run can have this id.
        """
        if not _ID.fullmatch(run_id):
            raise StorageMissing(f"there is no run {run_id[:80]!r}; it may have been deleted")
        return self.path / RUNS / run_id

    def remove_run(self, run_id: str) -> None:
        """Delete a run's files; a missing folder is no error.

        Raises:
            StorageError: they cannot be deleted; they stay.
        """
        folder = self.run(run_id)
        leaving = folder.with_name(f"{_LEAVING}{run_id}-{secrets.token_hex(3)}")
        try:
            # Renamed first, so that half a run is never visible.
            folder.rename(leaving)
        except FileNotFoundError:
            return
        except OSError as error:
            raise StorageError(
                f"the folder {folder} of a run cannot be deleted ({error.strerror}); make it "
                f"writable"
            ) from error
        shutil.rmtree(leaving, ignore_errors=True)

    def tidy(self) -> None:
        """Delete what a crash left of runs being deleted."""
        for folder in (self.path / RUNS).glob(f"{_LEAVING}*"):
            shutil.rmtree(folder, ignore_errors=True)

    def truth(self, name: str) -> Path:
        """Return the file of a truth, by the name in its record."""
        return self.path / TRUTHS / name

    def recording_bytes(self, run_id: str) -> int | None:
        """Return the size of a run's recording; None if there is none."""
        try:
            return (self.run(run_id) / RECORDING).stat().st_size
        except OSError:
            return None

    def disk_use(self, database: Path | None) -> DiskUse:
        """Return the disk space of everything; sparse and growing files count by their blocks.

        Args:
            database: the SQLite file, wherever it is; None if a server stores the rows.
        """
        total = _size(self.path)
        if database is not None and database.parent != self.path:
            total += sum(_size(each) for each in database.parent.glob(f"{database.name}*"))
        return DiskUse(total, self.free_bytes())

    def free_bytes(self) -> int:
        """Return the free space below the folder."""
        present = next(each for each in (self.path, *self.path.parents) if each.exists())
        return shutil.disk_usage(present).free


def _size(path: Path) -> int:
    return sum(each.st_blocks * _BLOCK for each in _stats(path))


def _stats(path: Path) -> Iterator[os.stat_result]:
    """Yield the status of everything below; skip what vanishes meanwhile."""
    try:
        yield path.lstat()
        if path.is_dir() and not path.is_symlink():
            for each in path.iterdir():
                yield from _stats(each)
    except OSError:
        return
