"""Calibrations by content: the same text is the same calibration, whatever it is called."""

from __future__ import annotations

from typing import Any

from sqlalchemy import func, select

from app.storage.database import Database
from app.storage.errors import StorageMissing
from app.storage.models import Calibration, Run
from app.storage.records import CalibrationRecord, utc_now
from app.storage.settings import read_setting, write_setting
from observer.calibration.formats.opencv_file import calibration_id

_ACTIVE = "calibrations.active"


class CalibrationTables(Database):
    """Texts are kept as they came; reading them is not this package's work."""

    def save_calibration(
        self, text: str, *, name: str, info: dict[str, Any] | None = None, listed: bool = True
    ) -> CalibrationRecord:
        """Keep a calibration; one with the same text is found again and takes the new name.

        What is known of that one already stays; keys of ``info`` are replaced.

        ``listed=False`` keeps one for a run's sake (a source's own) without showing it in lists;
        one that is listed stays so.
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
                row.info = {**row.info, **info}
            return _calibration(row)

    def get_calibration(self, id: str) -> CalibrationRecord | None:
        """One calibration, deleted ones that a run refers to included."""
        with self._reading() as session:
            row = session.get(Calibration, id)
            return None if row is None else _calibration(row)

    def list_calibrations(self) -> list[CalibrationRecord]:
        """Those that are listed, newest first."""
        query = (
            select(Calibration)
            .where(Calibration.listed)
            .order_by(Calibration.created_at.desc(), Calibration.id)
        )
        with self._reading() as session:
            return [_calibration(row) for row in session.scalars(query)]

    def change_calibration(
        self, id: str, *, name: str | None = None, info: dict[str, Any] | None = None
    ) -> CalibrationRecord:
        """Rename a calibration or add to what is known of it; keys of ``info`` are replaced.

        Raises:
            StorageMissing: there is no such calibration.
        """
        with self._writing() as session:
            row = session.get(Calibration, id)
            if row is None:
                raise StorageMissing(f"there is no calibration {id}; upload it first")
            if name is not None:
                row.name = name
            if info is not None:
                row.info = {**row.info, **info}
            return _calibration(row)

    def delete_calibration(self, id: str) -> bool:
        """Take it off the list (False: it is not there); the active one is deactivated.

        The text stays as long as a run refers to it: a run must remain repeatable.
        """
        with self._writing() as session:
            row = session.get(Calibration, id)
            if row is None or not row.listed:
                return False
            if read_setting(session, _ACTIVE) == id:
                write_setting(session, _ACTIVE, None)
            used = session.scalar(
                select(func.count()).select_from(Run).where(Run.calibration_id == id)
            )
            if used:
                row.listed = False
            else:
                session.delete(row)
            return True

    def activate_calibration(self, id: str | None) -> None:
        """Use this calibration from now on; None goes back to the source's own.

        Raises:
            StorageMissing: there is no such calibration.
        """
        with self._writing() as session:
            if id is not None and session.get(Calibration, id) is None:
                raise StorageMissing(f"there is no calibration {id}; upload it first")
            write_setting(session, _ACTIVE, id)

    def active_calibration(self) -> CalibrationRecord | None:
        """The calibration that replaces the sources' own, if any."""
        with self._reading() as session:
            id = read_setting(session, _ACTIVE)
            row = None if id is None else session.get(Calibration, id)
            return None if row is None else _calibration(row)


def _calibration(row: Calibration) -> CalibrationRecord:
    return CalibrationRecord(
        id=row.id,
        name=row.name,
        text=row.text,
        created_at=row.created_at,
        info=row.info,
        listed=row.listed,
    )
