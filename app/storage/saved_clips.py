"""Saved half minutes in the data folder: beside the run that was going, or by themselves."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from app.storage.errors import StorageError
from app.storage.folder import RINGS, DataFolder
from observer.recording.run_folder import RUNS

_STAMP = "%Y%m%d-%H%M%S-%f"
_NAME = re.compile(r"ring-(\d{8}-\d{6}-\d{6})")


@dataclass(frozen=True)
class SavedClip:
    """A recording of half a minute.

    Attributes:
        name: as in ``ring-20261122-131500-123456``, after the UTC at which it was saved.
        run_id: of the run that was going, None where none was.
        saved_at: ISO 8601 with its offset. path: absolute.
    """

    name: str
    run_id: str | None
    saved_at: str
    bytes: int
    path: Path


def new_clip(folder: DataFolder, run_id: str | None) -> Path:
    """Where the next one goes, absolute; nothing is made."""
    where = folder.path / RINGS if run_id is None else folder.run(run_id)
    return where.absolute() / f"ring-{datetime.now(UTC):{_STAMP}}.mcap"


def list_clips(folder: DataFolder) -> list[SavedClip]:
    """All of them, newest first; files of other names are left out."""
    found = [_ring(path, None) for path in (folder.path / RINGS).glob("ring-*.mcap")]
    for path in (folder.path / RUNS).glob("[!.]*/ring-*.mcap"):
        found.append(_ring(path, path.parent.name))
    return sorted(filter(None, found), key=lambda ring: ring.name, reverse=True)


def remove_clip(ring: SavedClip) -> None:
    """Delete it; one that is gone already is no error.

    Raises:
        StorageError: it cannot be deleted.
    """
    try:
        ring.path.unlink(missing_ok=True)
    except OSError as error:
        raise StorageError(
            f"{ring.path} cannot be deleted ({error.strerror}); make its folder writable"
        ) from error


def _ring(path: Path, run_id: str | None) -> SavedClip | None:
    named = _NAME.fullmatch(path.stem)
    if named is None:
        return None
    try:
        saved = datetime.strptime(named[1], _STAMP).replace(tzinfo=UTC)
        size = path.stat().st_size
    except (OSError, ValueError):
        # It went meanwhile, or somebody named it.
        return None
    return SavedClip(path.stem, run_id, saved.isoformat(), size, path.absolute())
