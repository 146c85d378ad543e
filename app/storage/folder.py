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
# Folder of saved clips that belong to no run.
RINGS = "rings"
# A run's folder during deletion; remains of a crash are deleted next time.
_LEAVING = ".deleted-"
_ID = re.compile(r"[0-9A-Za-z][0-9A-Za-z_-]{0,99}")
_BLOCK = 512


@dataclass(frozen=True)
class DiskUse:
    """Disk space in bytes.

    Attributes:
        runs: by run id, only for runs with a folder.
        truths: all truth files. database: with its log. copies: copies made before migrations
            and restorations, and databases that were moved aside. other: calibrations' images, ...
        free: space left.
    """

    runs: dict[str, int]
    truths: int
    database: int
    copies: int
    other: int
    free: int

    @property
    def total(self) -> int:
        """Return the size of the whole data folder."""
        return sum(self.runs.values()) + self.truths + self.database + self.copies + self.other


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
            raise StorageMissing(f"there is no run {run_id[:80]!r}; GET /api/runs lists them")
        return self.path / RUNS / run_id

    def make_run(self, run_id: str) -> Path:
        """Return the folder of a run's files, created if necessary.

        Raises:
            StorageError: it cannot be created.
        """
        folder = self.run(run_id)
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StorageError(
                f"the folder {folder} for a run cannot be made ({error.strerror}); choose a data "
                f"folder that you may write to"
            ) from error
        return folder

    def remove_run(self, run_id: str) -> None:
        """Delete a run's files; a missing folder is no error.

        Raises:
            StorageError: they cannot be deleted; they stay.
        """
        folder = self.run(run_id)
        leaving = folder.with_name(f"{_LEAVING}{run_id}-{secrets.token_hex(3)}")
        try:
            # Renamed first, so that nobody ever finds half a run.
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

    def run_bytes(self, run_id: str) -> int:
        """Return the disk space of a run, without its rows in the database."""
        return _size(self.run(run_id))

    def disk_use(self, database: Path | None) -> DiskUse:
        """Return the disk space of everything; sparse and growing files count by their blocks.

        Args:
            database: the SQLite file; None if a server stores the rows.
        """
        runs: dict[str, int] = {}
        truths = of_database = copies = other = 0
        if database is not None and database.parent != self.path:
            of_database = sum(_size(each) for each in database.parent.glob(f"{database.name}*"))
        for entry in self.path.iterdir() if self.path.is_dir() else ():
            if entry.name == RUNS:
                runs = {each.name: _size(each) for each in entry.iterdir() if each.is_dir()}
            elif entry.name == TRUTHS:
                truths = _size(entry)
            elif database is not None and entry.name.startswith(database.name):
                of_database += _size(entry)
            elif re.search(r"(\.|^)(before|corrupt)-", entry.name):
                copies += _size(entry)
            else:
                other += _size(entry)
        return DiskUse(runs, truths, of_database, copies, other, self.free_bytes())

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
