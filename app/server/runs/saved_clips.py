"""The last half minute: saved by a person or after a stop of the guard, listed, deleted."""

from __future__ import annotations

import asyncio

import structlog

from app.contract.commands import SaveRing
from app.contract.drive import IncidentEvent
from app.contract.runs import RingFile
from app.server.asking import ask
from app.server.errors import Conflict, NotThere
from app.server.shared import Shared
from app.storage.saved_clips import SavedClip, list_clips, new_clip, remove_clip
from observer.errors import DynamicObserverError

log = structlog.get_logger(__name__)

# Behind a stop of the guard, until the robot stands for sure; and until the next one is another.
_BEHIND_STOP_S = 3.0
_BETWEEN_RINGS_S = 30.0
# A quarter of a gigabyte onto a slow disk.
_SAVE_TIMEOUT_S = 30.0


class SavedClips:
    """Saves the last half minute: when a person wants it, and when the guard stopped a robot.

    Args:
        automatic: whether guard stops save it.
    """

    def __init__(self, shared: Shared, *, automatic: bool) -> None:
        self._shared = shared
        self._folder = shared.storage.folder
        self._automatic = automatic
        self._saved_at: float | None = None

    async def save(self) -> RingFile:
        """Save it beside the run, or in the folder ``rings`` where none goes.

        Raises:
            Conflict: none is kept of what is open. StorageFull: there is no room for it.
            NotAvailable: it failed, or there is no engine at the moment.
        """
        run = self._shared.run()
        file = new_clip(self._folder, None if run is None else run.id)
        saved = await ask(self._shared.engine, SaveRing(str(file)), timeout_s=_SAVE_TIMEOUT_S)
        return RingFile(
            str(file.relative_to(self._folder.path.absolute())), saved.bytes, saved.seconds
        )

    async def all(self) -> list[SavedClip]:
        """Those that were saved, newest first."""
        return await asyncio.to_thread(list_clips, self._folder)

    async def find(self, name: str) -> SavedClip:
        """One of them.

        Raises:
            NotThere: there is none of that name.
        """
        found = next((each for each in await self.all() if each.name == name), None)
        if found is None:
            raise NotThere(
                f"there is no saved half minute {name[:80]!r}; GET /api/recording/rings lists them"
            )
        return found

    async def delete(self, name: str) -> None:
        """Delete one of them for good.

        Raises:
            NotThere: there is none of that name. StorageError: it cannot be deleted.
        """
        await asyncio.to_thread(remove_clip, await self.find(name))

    def drive_said(self, event: object) -> None:
        """Save it soon behind a stop of the guard, so that the stop is in it."""
        if not (self._automatic and isinstance(event, IncidentEvent) and event.kind == "guard"):
            return
        now = self._shared.clock()
        if self._saved_at is not None and now - self._saved_at < _BETWEEN_RINGS_S:
            return
        self._saved_at = now
        self._shared.background.start(self._save_later())

    async def _save_later(self) -> None:
        await asyncio.sleep(_BEHIND_STOP_S)
        try:
            saved = await self.save()
            log.info("ring_saved", file=saved.file)
        except Conflict:
            # Of what can be played again nothing is kept.
            pass
        except DynamicObserverError as error:
            log.warning("ring_not_saved", reason=str(error))
