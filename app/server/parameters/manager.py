"""Parameters and presets: the current ones, those in the engine, and those in the database."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from app.contract.commands import SetParameters
from app.contract.parameters import ParameterValues, Preset, StoredValues
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
    named,
    preset_values,
    restored_parameters,
)
from app.server.shared import Shared
from app.storage import PresetRecord, StorageExists, StorageUnreadable, utc_now
from observer.errors import InputError
from observer.navigation.parameters import AllParameters
from observer.parameters import PRESET_HELP, ParameterValue, translated


class ParameterManager:
    """Manager of the parameters; used in the event loop. Changes need the shared lock, except
    ``change``.

    Attributes:
        current: the current parameters. followed: called when they change.
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
            f"the saved preset {name!r} is damaged and ignored; save it again"
            for name in self._storage.damaged_presets()
        ]
        try:
            saved = self._storage.load_parameters()
        except StorageUnreadable as error:
            saved = None
            warnings.append(str(error))
        if saved is not None:
            self.current, warning = restored_parameters(
                saved.values, saved.revision, self._preset_values, saved.based_on
            )
            warnings += [] if warning is None else [warning]
        return "; ".join(warnings) or None

    @property
    def _preset_values(self) -> dict[str, StoredValues]:
        return {name: record.values for name, record in self._saved.items()}

    def plan(self, preset_name: str | None, changes: ParameterValues) -> Revision:
        """Return the change that a preset and further values would make; change nothing.

        Raises:
            FieldError: there is no such preset.
            ParameterError: names every refused field and its range.
        """
        start = None if preset_name is None else self._preset(preset_name)
        return change(self.current, changes, self._preset_values, start, preset_name)

    def compose(
        self, preset_name: str | None, own: StoredValues, changes: ParameterValues
    ) -> ParametersInForce:
        """Return the parameters of a preset with changes; apply nothing.

        Args:
            own: the values to start from without a preset; unknown parameters are left out.

        Raises:
            FieldError, ParameterError: as ``plan``.
        """
        if preset_name is None:
            known = AllParameters().flat()
            start = AllParameters().changed({k: v for k, v in own.items() if k in known})
        else:
            start = self._preset(preset_name)
        values = start.changed(changes)
        return ParametersInForce(values, 0, matching_preset(values, self._preset_values))

    def _preset(self, name: str) -> AllParameters:
        try:
            return preset_values(name, self._preset_values)
        except InputError as error:
            raise FieldError(("body", "preset"), str(error)) from error

    async def change(
        self, changes: ParameterValues, based_on: str | None = None
    ) -> ParametersInForce:
        """Change parameters from the next frame on, completely or not at all.

        Args:
            based_on: the preset that the values come from; unchanged if left out.

        Raises:
            FieldError: there is no such preset.
            ParameterError: names every refused field and its range.
        """
        async with self._shared.lock:
            presets = self._preset_values
            if based_on is not None and based_on not in (*BUILT_IN, *presets):
                raise FieldError(("query", "based_on"), f"there is no preset {based_on!r}")
            revision = change(self.current, changes, presets, based_on=based_on)
            result = await self._apply(revision)
        self._shared.followers.status_changed()
        return result

    async def _apply(self, revision: Revision) -> ParametersInForce:
        """Apply a planned change, in the engine first."""
        if not revision.difference:
            return self.adopt(revision, self.current.frame, None)
        after, run = revision.after, self._shared.run()
        try:
            command = SetParameters(after.values.flat(), after.revision)
            frame = await ask(self._shared.engine, command)
        except NotAvailable as error:
            if not isinstance(error.__cause__, ProcessUnavailable):
                raise
            # The next engine receives them together with its source.
            frame = None
        return self.adopt(revision, frame, None if run is None else run.id)

    def adopt(self, revision: Revision, frame: int | None, run_id: str | None) -> ParametersInForce:
        """Record that a change applies from ``frame`` on."""
        if not revision.difference:
            self._call(revision.after)
            return self.current
        observed = revision.after.revision != self.current.revision
        self.current = replace(revision.after, frame=frame) if observed else revision.after
        self.followed()
        self._keep(revision, frame, run_id)
        return self.current

    def _keep(self, revision: Revision, frame: int | None, run_id: str | None) -> None:
        after = revision.after
        self._remember()
        note = self._storage.record_parameter_revision
        # It may be written only later, when a full disk has room again.
        change = partial(note, run_id, frame, after.revision, revision.difference, at=utc_now())
        self._writer.post(change)

    def _remember(self) -> None:
        now, save = self.current, self._storage.save_parameters
        values = now.values.flat()
        self._writer.post(partial(save, now.revision, values, now.preset, now.based_on))

    def _call(self, same: ParametersInForce) -> None:
        """Adopt new preset names for unchanged values."""
        if same != self.current:
            self.current = same
            self._remember()

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

    async def save_preset(
        self,
        name: str,
        help: str | None = None,
        values: ParameterValues | None = None,
        *,
        replace: bool = False,
    ) -> Preset:
        """Save values under a name.

        Args:
            help: description; if left out, that of the replaced preset.
            values: dotted name -> value, applied to the defaults; names from earlier versions are
                accepted. Default: the current values, which are then based on this preset.
            replace: replace an existing preset of that name.

        Raises:
            Conflict: the name is taken. ParameterError: names every refused field and its range.
            StorageError: it could not be saved.
        """
        if name in BUILT_IN:
            raise Conflict(f"the preset {name} is built in; choose another name")
        flat = (
            self.current.values if values is None else AllParameters().changed(translated(values))
        ).flat()
        if help is None:
            help = self._saved[name].help if name in self._saved else ""
        save = partial(self._storage.save_preset, name, flat, help=help, replace=replace)
        try:
            self._saved[name] = await asyncio.to_thread(save)
        except StorageExists as error:
            raise Conflict(str(error)) from error
        based_on = name if values is None else self.current.based_on
        self._call(named(self.current, self._preset_values, based_on))
        return Preset(name, help, flat, False)

    async def delete_preset(self, name: str) -> None:
        """Delete a saved preset.

        Raises:
            Conflict: it is built in. NotThere: there is no such preset. StorageError: it could not
                be deleted.
        """
        if name in BUILT_IN:
            raise Conflict(f"the preset {name} is built in and cannot be deleted")
        deleted = await asyncio.to_thread(self._storage.delete_preset, name)
        if self._saved.pop(name, None) is None and not deleted:
            raise NotThere(f"there is no preset {name!r}; it may have been deleted")
        self._call(named(self.current, self._preset_values, self.current.based_on))
