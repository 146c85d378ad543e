"""Source of a comparison: the open one, one named, or the last seconds of the open cameras."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

from app.contract.runs import ClipFile
from app.server.errors import FieldError
from app.server.runs.saved_clips import SavedClips
from app.server.shared import Shared
from app.server.source.chosen_source import ChosenSource, choose_source
from app.server.source.hints import source_title
from app.server.source.manager import SourceManager
from app.storage import CalibrationRecord
from observer.errors import DynamicObserverError
from observer.opening import exclusive_world, live_devices, shown_spec
from observer.recording.run_folder import RECORDING, RUNS

_LONGEST_TITLE = 80
_SIMULATED = "simulated:"


@dataclass(frozen=True)
class ComparedSource:
    """Source of a comparison.

    Attributes:
        title: display name. spec: spec that opens it. shown: the spec without passwords.
        calibration: used instead of its own, or None.
        clip: temporary recording saved for the comparison, or None.
        original: id of the run whose recording it is, or None.
    """

    title: str
    spec: str
    shown: str
    calibration: CalibrationRecord | None
    clip: Path | None
    original: str | None


class ComparedSources:
    """Chooser of what is compared."""

    def __init__(self, shared: Shared, source: SourceManager, clips: SavedClips) -> None:
        self._shared = shared
        self._storage = shared.storage
        self._source = source
        self._clips = clips

    def title(self, source: str | None) -> str:
        """Return the display name of a source; None for the open one."""
        return _title(self._source.wanted if source is None else ChosenSource(source, None))

    @asynccontextmanager
    async def chosen(self, source: str | None) -> AsyncIterator[ComparedSource]:
        """Yield what is to be compared; a clip saved for it is deleted after the block.

        Args:
            source: None for the open one.

        Raises:
            FieldError: the source cannot be compared. Conflict, StorageFull, NotAvailable: as for
                ``SavedClips.save``.
        """
        compared = await self._choose(source)
        try:
            yield compared
        finally:
            if compared.clip is not None:
                _delete(compared.clip)

    async def _choose(self, source: str | None) -> ComparedSource:
        if source is None:
            chosen, state = self._source.wanted, self._source.state
            if state.source is not None and state.source.live:
                return await self._of_clip(chosen)
            if exclusive_world(chosen.source) is not None:
                raise FieldError(
                    ("body", "source"),
                    "a CoppeliaSim scene cannot be played twice; record a run of it and compare "
                    "with its recording",
                )
        else:
            if live_devices(source) or exclusive_world(source) is not None:
                raise FieldError(
                    ("body", "source"),
                    "open live cameras as the source first; their last seconds are then compared",
                )
            chosen = await asyncio.to_thread(choose_source, self._storage, source, None)
        return ComparedSource(
            title=_title(chosen),
            spec=chosen.source,
            shown=shown_spec(chosen.source),
            calibration=chosen.calibration,
            clip=None,
            original=_run_of(Path(chosen.source)),
        )

    async def _of_clip(self, chosen: ChosenSource) -> ComparedSource:
        saving = asyncio.ensure_future(self._clips.save())
        try:
            clip = self._path(await asyncio.shield(saving))
        except asyncio.CancelledError:
            # The engine saves it all the same.
            self._shared.background.start(self._delete_saved(saving))
            raise
        return ComparedSource(
            title=_title(chosen),
            spec=str(clip),
            shown=shown_spec(chosen.source),
            # The calibration in use; if that is the source's own, the clip holds it.
            calibration=chosen.calibration,
            clip=clip,
            original=None,
        )

    def _path(self, clip: ClipFile) -> Path:
        return self._storage.folder.path.absolute() / clip.file

    async def _delete_saved(self, saving: asyncio.Future[ClipFile]) -> None:
        """Delete a clip as soon as it has been saved."""
        with contextlib.suppress(DynamicObserverError):
            _delete(self._path(await saving))


def _delete(clip: Path) -> None:
    with contextlib.suppress(OSError):
        clip.unlink(missing_ok=True)


def _title(chosen: ChosenSource) -> str:
    simulated = chosen.source.startswith(_SIMULATED)
    title = source_title(chosen.source) if simulated else shown_spec(chosen.source)
    shown = chosen.name or title
    return shown if len(shown) <= _LONGEST_TITLE else f"…{shown[1 - _LONGEST_TITLE :]}"


def _run_of(path: Path) -> str | None:
    """Return the id of the run whose recording this path is, or None."""
    is_one = path.name == RECORDING and path.parent.parent.name == RUNS
    return path.parent.name if is_one else None
