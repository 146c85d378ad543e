"""Last parameters, their revisions, and presets saved by users."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from sqlalchemy import select

from app.contract.values import filled
from app.storage.database import Database
from app.storage.errors import StorageExists
from app.storage.models import Preset, Revision
from app.storage.records import ParameterRevision, PresetRecord, SavedParameters, utc_now
from app.storage.settings import read_setting, write_setting
from observer.parameters import translated

_CURRENT = "parameters.current"


class ParameterTables(Database):
    """Tables of parameters: flat maps, dotted name -> JSON value, read under the names of today."""

    def save_parameters(self, revision: int, values: dict[str, Any], preset: str | None) -> None:
        """Store the parameters in force; the next start begins with them."""
        with self._writing() as session:
            current = {"revision": revision, "values": values, "preset": preset}
            write_setting(session, _CURRENT, current)

    def load_parameters(self) -> SavedParameters | None:
        """Return the last parameters; None in a new database."""
        with self._reading() as session:
            current = read_setting(session, _CURRENT)
        if current is None:
            return None
        return SavedParameters(**{**current, "values": translated(current["values"])})

    def record_parameter_revision(
        self, run_id: str | None, frame: int | None, revision: int, difference: dict[str, Any]
    ) -> ParameterRevision:
        """Record that the values in ``difference`` hold from ``frame`` on.

        Raises:
            StorageMissing: there is no such run.
        """
        record = ParameterRevision(run_id, frame, revision, dict(difference), utc_now())
        with self._writing() as session:
            session.add(Revision(**asdict(record)))
        return record

    def parameter_revisions(self, run_id: str | None) -> list[ParameterRevision]:
        """Return the changes during a run (``None``: those outside any run), oldest first."""
        query = select(Revision).where(Revision.run_id == run_id).order_by(Revision.id)
        with self._reading() as session:
            return [
                filled(ParameterRevision, row, difference=translated(row.difference))
                for row in session.scalars(query)
            ]

    def save_preset(
        self, name: str, values: dict[str, Any], *, help: str = "", replace: bool = False
    ) -> PresetRecord:
        """Store values under a name.

        Raises:
            StorageExists: the name is taken and ``replace`` is not set.
        """
        with self._writing() as session:
            row = session.get(Preset, name)
            if row is not None and not replace:
                raise StorageExists(
                    f'a preset named "{name}" is there already; choose another name or delete it'
                )
            if row is None:
                row = Preset(name=name, created_at=utc_now())
                session.add(row)
            row.values = dict(values)
            row.help = help
            return _preset(row)

    def list_presets(self) -> list[PresetRecord]:
        """Return all saved presets by name."""
        with self._reading() as session:
            # Sorted here: databases order text by their locale.
            return sorted(map(_preset, session.scalars(select(Preset))), key=lambda one: one.name)

    def delete_preset(self, name: str) -> bool:
        """Delete a preset; return False if there was none."""
        with self._writing() as session:
            row = session.get(Preset, name)
            if row is not None:
                session.delete(row)
            return row is not None


def _preset(row: Preset) -> PresetRecord:
    return filled(PresetRecord, row, values=translated(row.values))
