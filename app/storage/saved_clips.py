"""Saved clips of half a minute in the data folder: beside the current run, or by themselves."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from app.storage.errors import StorageError
from app.storage.folder import CLIPS, FORMER_CLIPS, DataFolder
from observer.recording.run_folder import RUNS

_STAMP = "%Y%m%d-%H%M%S-%f"
# Clips used to be called rings.
_NAME = re.compile(r"(?:clip|ring)-(\d{8}-\d{6}-\d{6})")


@dataclass(frozen=True)
class SavedClip:
    """Recording of half a minute.

    Attributes:
        name: such as ``clip-20261122-131500-123456``, from the UTC time of saving.
        run_id: id of the run in progress, None if there was none.
        saved_at: ISO 8601 with its offset. path: absolute.
    """

    name: str
    run_id: str | None
    saved_at: str
    bytes: int
    path: Path


def new_clip(folder: DataFolder, run_id: str | None) -> Path:
    """Return the absolute path for the next clip; create nothing."""
    where = folder.path / CLIPS if run_id is None else folder.run(run_id)
    return where.absolute() / f"clip-{datetime.now(UTC):{_STAMP}}.mcap"


def list_clips(folder: DataFolder) -> list[SavedClip]:
    """Return all clips, newest first; skip files with other names."""
    alone = (path for name in (CLIPS, FORMER_CLIPS) for path in (folder.path / name).glob("*.mcap"))
    found = [_clip(path, None) for path in alone]
    for path in (folder.path / RUNS).glob("[!.]*/*.mcap"):
        found.append(_clip(path, path.parent.name))
    return sorted(filter(None, found), key=lambda clip: clip.saved_at, reverse=True)


def remove_clip(clip: SavedClip) -> None:
    """Delete a clip; one that is gone already is no error.

    Raises:
        StorageError: it cannot be deleted.
    """
    try:
        clip.path.unlink(missing_ok=True)
    except OSError as error:
        raise StorageError(
            f"{clip.path} cannot be deleted ({error.strerror}); make its folder writable"
        ) from error


def _clip(path: Path, run_id: str | None) -> SavedClip | None:
    named = _NAME.fullmatch(path.stem)
    if named is None:
        return None
    try:
        saved = datetime.strptime(named[1], _STAMP).replace(tzinfo=UTC)
        size = path.stat().st_size
    except (OSError, ValueError):
        # The file has disappeared, or its name contains no valid time.
        return None
    return SavedClip(path.stem, run_id, saved.isoformat(), size, path.absolute())
