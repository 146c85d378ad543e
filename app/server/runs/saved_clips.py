"""Clips of the last half minute: saved by the user or after a guard stop, listed, deleted."""

from __future__ import annotations

import asyncio

import structlog

from app.contract.commands import SaveClip
from app.contract.drive import IncidentEvent
from app.contract.runs import ClipFile
from app.server.asking import ask
from app.server.errors import Conflict, NotThere
from app.server.shared import Shared
from app.storage.saved_clips import SavedClip, list_clips, new_clip, remove_clip
from observer.errors import DynamicObserverError

log = structlog.get_logger(__name__)

# Delay after a guard stop by which the robot has certainly stopped, and the minimum interval
# between two clips.
_BEHIND_STOP_S = 3.0
_BETWEEN_CLIPS_S = 30.0
# Enough to write a quarter of a gigabyte to a slow disk.
_SAVE_TIMEOUT_S = 30.0


class SavedClips:
    """Saver of the last half minute: on request, and after a guard stop.

    Args:
        automatic: whether guard stops save a clip.
    """

    def __init__(self, shared: Shared, *, automatic: bool) -> None:
        self._shared = shared
        self._folder = shared.storage.folder
        self._automatic = automatic
        self._saved_at: float | None = None

    async def save(self) -> ClipFile:
        """Save the clip with the current run, or in the folder ``clips`` without one.

        Raises:
            Conflict: no ring buffer is kept for the open source. StorageFull: there is no room for
                the clip.
            NotAvailable: saving failed, or there is no engine at the moment.
        """
        run = self._shared.run()
        file = new_clip(self._folder, None if run is None else run.id)
        saved = await ask(self._shared.engine, SaveClip(str(file)), timeout_s=_SAVE_TIMEOUT_S)
        return ClipFile(
            str(file.relative_to(self._folder.path.absolute())), saved.bytes, saved.seconds
        )

    async def all(self) -> list[SavedClip]:
        """Return the saved clips, newest first."""
        return await asyncio.to_thread(list_clips, self._folder)

    async def find(self, name: str) -> SavedClip:
        """Return one clip.

        Raises:
            NotThere: there is no clip of that name.
        """
        found = next((each for each in await self.all() if each.name == name), None)
        if found is None:
            raise NotThere(f"there is no saved clip {name[:80]!r}; it may have been deleted")
        return found

    async def delete(self, name: str) -> None:
        """Permanently delete a clip.

        Raises:
            NotThere: there is no clip of that name. StorageError: it cannot be deleted.
        """
        await asyncio.to_thread(remove_clip, await self.find(name))

    def drive_said(self, event: object) -> None:
        """Save a clip shortly after a guard stop, so that it includes the whole stop."""
        if not (self._automatic and isinstance(event, IncidentEvent) and event.kind == "guard"):
            return
        now = self._shared.clock()
        if self._saved_at is not None and now - self._saved_at < _BETWEEN_CLIPS_S:
            return
        self._saved_at = now
        self._shared.background.start(self._save_later())

    async def _save_later(self) -> None:
        await asyncio.sleep(_BEHIND_STOP_S)
        try:
            saved = await self.save()
            log.info("clip_saved", file=saved.file)
        except Conflict:
            # No ring buffer is kept for a source that can be replayed.
            pass
        except DynamicObserverError as error:
            log.warning("clip_not_saved", reason=str(error))
