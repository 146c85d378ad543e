"""Parameters and presets: in force, in the engine, in the database."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from app.contract.commands import SetParameters
from app.contract.parameters import Preset
from app.runtime.errors import ProcessUnavailable
from app.server.asking import ask
from app.server.errors import Conflict, FieldError, NotAvailable, NotThere
from app.server.parameters.in_force import (
    BUILT_IN,
    ParametersInForce,
    Revision,
    built_in,
    change,
    matching_preset,
    preset_values,
    restored_parameters,
)
from app.server.shared import Shared
from app.storage import PresetRecord, StorageExists, StorageUnreadable
from observer.errors import InputError
from observer.guard.parameters import AllParameters
from observer.parameters import PRESET_HELP, ParameterValue


class ParameterManager:
    """Manager of the parameters; used in the event loop. Changes need the shared lock, except
    ``change``.

    Attributes:
        current: the parameters in force. followed: called when they change.
    """

    def __init__(self, shared: Shared) -> None:
        self._shared = shared
        self._storage = shared.storage
        self._writer = shared.writer
        self._saved: dict[str, PresetRecord] = {}
        self.current = ParametersInForce(built_in("default"), 0, "default")
        self.followed: Callable[[], None] = lambda: None

    def group(self, name: str) -> dict[str, ParameterValue]:
        """Return the parameters of one group, by dotted name."""
        values = self.current.values.flat()
        return {key: value for key, value in values.items() if key.startswith(f"{name}.")}

    def load(self) -> str | None:
        """Load the last parameters from the database; return a warning if some could not be used.

        Runs in a worker thread, before any other call.
        """
        self._saved = {record.name: record for record in self._storage.list_presets()}
        warnings = [
            f"the saved preset {name!r} is damaged and left out; save it again"
            for name in self._storage.damaged_presets()
        ]
        try:
            saved = self._storage.load_parameters()
        except StorageUnreadable as error:
            saved = None
            warnings.append(str(error))
        if saved is not None:
            self.current, warning = restored_parameters(saved.values, saved.revision, saved.preset)
            warnings += [] if warning is None else [warning]
        return "; ".join(warnings) or None

    @property
    def _preset_values(self) -> dict[str, Mapping[str, ParameterValue]]:
        return {name: record.values for name, record in self._saved.items()}

    def plan(self, preset_name: str | None, changes: Mapping[str, Any]) -> Revision:
        """Return the change that a preset and further values would make; change nothing.

        Raises:
            FieldError: there is no such preset.
            ParameterError: names every refused field and its range.
        """
        start: AllParameters | None = None
        if preset_name is not None:
            try:
                start = preset_values(preset_name, self._preset_values)
            except InputError as error:
                raise FieldError(("body", "preset"), str(error)) from error
        return change(self.current, changes, self._preset_values, start)

    async def change(self, changes: Mapping[str, Any]) -> ParametersInForce:
        """Change parameters from the next frame on, completely or not at all.

        Raises:
            ParameterError: names every refused field and its range.
        """
        async with self._shared.lock:
            result = await self._apply(self.plan(None, changes))
        self._shared.followers.status_changed()
        return result

    async def _apply(self, revision: Revision) -> ParametersInForce:
        """Apply a planned change, in the engine first."""
        if not revision.difference:
            return self.current
        after, run = revision.after, self._shared.run()
        try:
            command = SetParameters(after.values.flat(), after.revision)
            frame = await ask(self._shared.engine, command)
        except NotAvailable as error:
            if not isinstance(error.__cause__, ProcessUnavailable):
                raise
            # The next engine gets them together with its source.
            frame = None
        return self.adopt(revision, frame, None if run is None else run.id)

    def adopt(self, revision: Revision, frame: int | None, run_id: str | None) -> ParametersInForce:
        """Record that a change is in force from ``frame`` on."""
        if not revision.difference:
            return self.current
        observed = revision.after.revision != self.current.revision
        self.current = replace(revision.after, frame=frame) if observed else revision.after
        self.followed()
        self._keep(revision, frame, run_id)
        return self.current

    def _keep(self, revision: Revision, frame: int | None, run_id: str | None) -> None:
        after, storage = revision.after, self._storage
        values = after.values.flat()
        self._writer.post(partial(storage.save_parameters, after.revision, values, after.preset))
        note = storage.record_parameter_revision
        self._writer.post(partial(note, run_id, frame, after.revision, revision.difference))

    def presets(self) -> list[Preset]:
        """Return the built-in presets, then the saved ones by name."""
        own = [
            Preset(name, PRESET_HELP.get(name, ""), built_in(name).flat(), True)
            for name in BUILT_IN
        ]
        saved = [
            Preset(name, record.help, dict(record.values), False)
            for name, record in sorted(self._saved.items())
        ]
        return own + saved

    async def save_preset(self, name: str, help: str) -> Preset:
        """Save the current values under a name.

        Raises:
            Conflict: the name is taken. StorageError: it could not be saved.
        """
        if name in BUILT_IN:
            raise Conflict(f"the preset {name} is built in; choose another name")
        values = self.current.values.flat()
        try:
            self._saved[name] = await asyncio.to_thread(
                self._storage.save_preset, name, values, help=help
            )
        except StorageExists as error:
            raise Conflict(str(error)) from error
        self._rename()
        return Preset(name, help, values, False)

    async def delete_preset(self, name: str) -> None:
        """Delete a saved preset.

        Raises:
            Conflict: it is built in. NotThere: there is no such preset. StorageError: it could not
                be deleted.
        """
        if name in BUILT_IN:
            raise Conflict(f"the preset {name} is built in and stays")
        deleted = await asyncio.to_thread(self._storage.delete_preset, name)
        if self._saved.pop(name, None) is None and not deleted:
            raise NotThere(f"there is no preset {name!r}; it may have been deleted")
        self._rename()

    def _rename(self) -> None:
        name = matching_preset(self.current.values, self._preset_values)
        self.current = replace(self.current, preset=name)
