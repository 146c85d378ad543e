"""Recently opened sources; the list survives a restart of the server."""

from __future__ import annotations

import asyncio
from functools import partial
from pathlib import Path

from app.contract.sources import SourceEntry
from app.server.shared import Shared
from app.server.source.chosen_source import RUN
from app.server.source.hints import source_entries
from observer.opening import shown_spec
from observer.recording.run_folder import RECORDING, RUNS

_KEY = "recent_sources"
_MOST = 12


class RecentSources:
    """Sources in the order of their last opening; used in the event loop.

    Attributes:
        specs: texts that open them, newest first, without user names and passwords.
    """

    def __init__(self, shared: Shared) -> None:
        """Start empty; ``load`` restores the stored ones."""
        self.specs: tuple[str, ...] = ()
        self._storage = shared.storage
        self._writer = shared.writer

    def load(self) -> None:
        """Load the stored sources; call it in a worker thread, before any other method."""
        stored = self._storage.get_setting(_KEY)
        if isinstance(stored, list):
            self.specs = tuple(each for each in stored if isinstance(each, str))[:_MOST]

    def opened(self, source: str) -> None:
        """Put a source at the head of the list."""
        spec = shown_spec(source)
        if spec != source and "@" in source:
            # It cannot be reopened without its password, which must not be shown to everyone.
            return
        spec = self._named_by_run(spec)
        if self.specs[:1] == (spec,):
            return
        self.specs = (spec, *(each for each in self.specs if each != spec))[:_MOST]
        self._writer.post(partial(self._storage.set_setting, _KEY, list(self.specs)))

    async def entries(self) -> list[SourceEntry]:
        """Return all suggestions: these sources, the built-in ones, and templates for others."""
        return list(await asyncio.to_thread(self._entries))

    def _entries(self) -> tuple[SourceEntry, ...]:
        names = {
            spec: self._run_name(spec.removeprefix(RUN))
            for spec in self.specs
            if spec.startswith(RUN)
        }
        there = [spec for spec in self.specs if names.get(spec, spec) is not None]
        return source_entries(there, {spec: name for spec, name in names.items() if name})

    def _named_by_run(self, spec: str) -> str:
        """Return the spec that names a run's recording by the run; return any other unchanged."""
        path = Path(spec)
        if path.name != RECORDING or path.parent.parent != self._runs:
            return spec
        return f"{RUN}{path.parent.name}"

    @property
    def _runs(self) -> Path:
        return self._storage.folder.path.absolute() / RUNS

    def _run_name(self, run_id: str) -> str | None:
        run = self._storage.get_run(run_id)
        return None if run is None or run.deleted_at is not None else run.name
