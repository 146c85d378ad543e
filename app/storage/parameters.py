"""Last parameters, their revisions, and presets saved by users."""

from __future__ import annotations

import dataclasses

from sqlalchemy import select

from app.contract.parameters import ParameterValues
from app.contract.values import filled, of_plain
from app.storage.database import Database
from app.storage.errors import StorageExists, StorageUnreadable
from app.storage.models import Preset, Revision
from app.storage.records import ParameterRevision, PresetRecord, SavedParameters, utc_now
from app.storage.settings import read_setting, write_setting
from observer.parameters import translated

_CURRENT = "parameters.current"
# Largest value of the database's column of revisions.
_MOST_REVISIONS = 2**31 - 1


class ParameterTables(Database):
    """Tables of parameters: flat maps, dotted name -> JSON value; reading translates old names."""

    def save_parameters(
        self,
        revision: int,
        values: ParameterValues,
        preset: str | None,
        based_on: str | None = None,
    ) -> None:
        """Store the current parameters; the next start begins with them."""
        saved = SavedParameters(revision, values, preset, based_on)
        with self._writing() as session:
            write_setting(session, _CURRENT, dataclasses.asdict(saved))

    def load_parameters(self) -> SavedParameters | None:
        """Return the last parameters; None in a new database.

        Raises:
            StorageUnreadable: they were damaged by hand.
        """
        with self._reading() as session:
            current = read_setting(session, _CURRENT)
        if current is None:
            return None
        try:
            saved = of_plain(SavedParameters, current)
        except ValueError:
            saved = None
        if saved is None or not 0 <= saved.revision <= _MOST_REVISIONS:
            raise StorageUnreadable(
                f"the saved parameters in the database {self.where} are damaged and were reset to "
                "their defaults"
            )
        return dataclasses.replace(saved, values=translated(saved.values))

    def record_parameter_revision(
        self,
        run_id: str | None,
        frame: int | None,
        revision: int,
        difference: ParameterValues,
        *,
        at: str | None = None,
    ) -> ParameterRevision:
        """Record that the values in ``difference`` hold from ``frame`` on.

        Args:
            at: when they changed; None: now.

        Raises:
            StorageMissing: there is no such run.
        """
        record = ParameterRevision(run_id, frame, revision, dict(difference), at or utc_now())
        with self._writing() as session:
            session.add(Revision(**dataclasses.asdict(record)))
        return record

    def parameter_revisions(self, run_id: str | None) -> list[ParameterRevision]:
        """Return the changes during a run (``None``: those outside any run), oldest first.

        One that was damaged by hand is left out.
        """
        query = select(Revision).where(Revision.run_id == run_id).order_by(Revision.id)
        with self._reading() as session:
            return [
                filled(ParameterRevision, row, difference=translated(row.difference))
                for row in session.scalars(query)
                if isinstance(row.difference, dict)
            ]

    def save_preset(
        self, name: str, values: ParameterValues, *, help: str = "", replace: bool = False
    ) -> PresetRecord:
        """Store values under a name.

        Raises:
            StorageExists: the name is taken by a sound preset and ``replace`` is not set.
        """
        with self._writing() as session:
            row = session.get(Preset, name)
            if row is not None and not replace and isinstance(row.values, dict):
                raise StorageExists(
                    f'a preset named "{name}" already exists; choose another name or delete it'
                )
            if row is None:
                row = Preset(name=name, created_at=utc_now())
                session.add(row)
            row.values = dict(values)
            row.help = help
            return _preset(row)

    def list_presets(self) -> list[PresetRecord]:
        """Return the saved presets by name, without ``damaged_presets``."""
        with self._reading() as session:
            rows = [row for row in session.scalars(select(Preset)) if isinstance(row.values, dict)]
        # Sorted here: databases order text by their locale.
        return sorted(map(_preset, rows), key=lambda one: one.name)

    def damaged_presets(self) -> list[str]:
        """Return the names of saved presets whose values were damaged by hand, sorted."""
        with self._reading() as session:
            rows = session.scalars(select(Preset))
            return sorted(row.name for row in rows if not isinstance(row.values, dict))

    def delete_preset(self, name: str) -> bool:
        """Delete a preset; return False if there was none."""
        with self._writing() as session:
            row = session.get(Preset, name)
            if row is not None:
                session.delete(row)
            return row is not None


def _preset(row: Preset) -> PresetRecord:
    return filled(PresetRecord, row, values=translated(row.values))
