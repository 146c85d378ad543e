"""The data folder: what is kept in files beside the database, and how much of the disk it takes."""

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
# Saved stretches of what no run kept.
RINGS = "rings"
# A run's folder on its way out; what a crash leaves of it goes next time.
_LEAVING = ".deleted-"
_ID = re.compile(r"[0-9A-Za-z][0-9A-Za-z_-]{0,99}")
_BLOCK = 512


@dataclass(frozen=True)
class DiskUse:
    """Bytes on the disk.

    Attributes:
        runs: by run id, only those that have a folder.
        truths: all truth files. database: with its log. copies: made before migrations and
            restorations, and databases that were moved aside. other: calibrations' images, ...
        free: what may still be written.
    """

    runs: dict[str, int]
    truths: int
    database: int
    copies: int
    other: int
    free: int

    @property
    def total(self) -> int:
        """All of the data folder."""
        return sum(self.runs.values()) + self.truths + self.database + self.copies + self.other


class DataFolder:
    """Args:
    path: the folder; it need not exist.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def run(self, run_id: str) -> Path:
        """Where a run's files are: ``recording.mcap`` and whatever belongs to it.

        Raises:
            StorageMissing: no run can have this id.
        """
        if not _ID.fullmatch(run_id):
            raise StorageMissing(f"there is no run {run_id[:80]!r}; GET /api/runs lists them")
        return self.path / RUNS / run_id

    def make_run(self, run_id: str) -> Path:
        """The same, made if need be.

        Raises:
            StorageError: it cannot be made.
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
        """Delete a run's files; a folder that is not there is no error.

        Raises:
            StorageError: they cannot be deleted; they stay.
        """
        folder = self.run(run_id)
        leaving = folder.with_name(f"{_LEAVING}{run_id}-{secrets.token_hex(3)}")
        try:
            # At once or not at all: nobody finds half a run.
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
        """Delete what a crash left of runs that were being deleted."""
        for folder in (self.path / RUNS).glob(f"{_LEAVING}*"):
            shutil.rmtree(folder, ignore_errors=True)

    def truth(self, name: str) -> Path:
        """The file of a truth, by the name of its record."""
        return self.path / TRUTHS / name

    def recording_bytes(self, run_id: str) -> int | None:
        """The size of a run's recording; None where there is none."""
        try:
            return (self.run(run_id) / RECORDING).stat().st_size
        except OSError:
            return None

    def run_bytes(self, run_id: str) -> int:
        """What a run takes of the disk, without its rows in the database."""
        return _size(self.run(run_id))

    def disk_use(self, database: Path | None) -> DiskUse:
        """What all takes; sparse and growing files by the blocks that they have.

        Args:
            database: the SQLite file, None where a server keeps the rows.
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
        """What may still be written below the folder."""
        present = next(each for each in (self.path, *self.path.parents) if each.exists())
        return shutil.disk_usage(present).free


def _size(path: Path) -> int:
    return sum(each.st_blocks * _BLOCK for each in _stats(path))


def _stats(path: Path) -> Iterator[os.stat_result]:
    """Of everything below; what vanishes meanwhile is left out."""
    try:
        yield path.lstat()
        if path.is_dir() and not path.is_symlink():
            for each in path.iterdir():
                yield from _stats(each)
    except OSError:
        return
