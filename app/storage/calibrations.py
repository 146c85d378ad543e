"""Calibrations, identified by content: the same text is the same calibration under any name."""

from __future__ import annotations

from collections.abc import Callable

from sqlalchemy import select
from sqlalchemy.orm import Session

from app.contract.values import JsonObject, filled
from app.storage.database import Database
from app.storage.errors import StorageMissing
from app.storage.models import Calibration, Run
from app.storage.records import CalibrationRecord, mapping, utc_now
from app.storage.settings import read_setting, write_setting
from observer.calibration.formats.opencv_file import calibration_id

_ACTIVE = "calibrations.active"


class CalibrationTables(Database):
    """Tables of calibrations. Texts are stored unchanged; this package does not parse them."""

    def save_calibration(
        self, text: str, *, name: str, info: JsonObject | None = None, listed: bool = True
    ) -> CalibrationRecord:
        """Store a calibration; an existing one with the same text takes the new name.

        Its existing ``info`` stays, except for keys that are replaced.

        ``listed=False`` stores one only for a run (a source's own) without listing it; one that is
        listed already stays listed.
        """
        key = calibration_id(text)
        with self._writing() as session:
            row = session.get(Calibration, key)
            if row is None:
                row = Calibration(
                    id=key, name=name, text=text, created_at=utc_now(), info={}, listed=listed
                )
                session.add(row)
            if listed or not row.listed:
                row.name = name
            row.listed = row.listed or listed
            if info is not None:
                row.info = {**mapping(row.info), **info}
            return _record(row)

    def get_calibration(self, id: str) -> CalibrationRecord | None:
        """Return one calibration, including deleted ones that a run refers to."""
        with self._reading() as session:
            row = session.get(Calibration, id)
            return None if row is None else _record(row)

    def list_calibrations(self) -> list[CalibrationRecord]:
        """Return the listed calibrations, newest first."""
        query = (
            select(Calibration)
            .where(Calibration.listed)
            .order_by(Calibration.created_at.desc(), Calibration.id)
        )
        with self._reading() as session:
            return [_record(row) for row in session.scalars(query)]

    def change_calibration(
        self,
        id: str,
        *,
        name: str | None = None,
        info: JsonObject | Callable[[CalibrationRecord], JsonObject] | None = None,
    ) -> CalibrationRecord:
        """Rename a calibration or extend its ``info``; existing keys are replaced.

        Args:
            info: the new keys, or a function that makes them from the record as it is now: nobody
                else changes it meanwhile.

        Raises:
            StorageMissing: there is no such calibration.
        """
        with self._writing() as session:
            row = _existing(session, id)
            if name is not None:
                row.name = name
            if info is not None:
                extended = info(_record(row)) if callable(info) else info
                row.info = {**mapping(row.info), **extended}
            return _record(row)

    def delete_calibration(self, id: str) -> bool:
        """Remove it from the list (False if absent) and deactivate it if active.

        The text stays while a run refers to it: a run must remain repeatable.
        """
        with self._writing() as session:
            row = session.get(Calibration, id)
            if row is None or not row.listed:
                return False
            if read_setting(session, _ACTIVE) == id:
                write_setting(session, _ACTIVE, None)
            if session.scalar(select(Run.id).where(Run.calibration_id == id).limit(1)):
                row.listed = False
            else:
                session.delete(row)
            return True

    def activate_calibration(self, id: str | None) -> None:
        """Use this calibration from now on; None restores the source's own.

        Raises:
            StorageMissing: there is no such calibration.
        """
        with self._writing() as session:
            if id is not None:
                _existing(session, id)
            write_setting(session, _ACTIVE, id)

    def active_calibration(self) -> CalibrationRecord | None:
        """Return the calibration that replaces the sources' own, if any."""
        with self._reading() as session:
            id = read_setting(session, _ACTIVE)
            row = None if id is None else session.get(Calibration, str(id))
            return None if row is None else _record(row)


def _record(row: Calibration) -> CalibrationRecord:
    return filled(CalibrationRecord, row, info=mapping(row.info))


def _existing(session: Session, id: str) -> Calibration:
    row = session.get(Calibration, id)
    if row is None:
        raise StorageMissing(f"there is no calibration {id}; upload it first")
    return row
