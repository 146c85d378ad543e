"""Observed speeds of runs, and incidents that stopped robots during them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, fields

from sqlalchemy import delete, insert, select

from app.contract.robots import StopMeasured
from app.contract.values import JsonObject, filled
from app.storage.database import Database
from app.storage.models import Incident, IncidentStop, Speed
from app.storage.records import IncidentRecord, SpeedRow
from app.storage.runs import existing_run

_SPEED_COLUMNS = [getattr(Speed, field.name) for field in fields(SpeedRow)]


class SpeedTables(Database):
    """Tables of rows for existing runs; they are deleted with their run."""

    def append_speeds(self, rows: Iterable[SpeedRow]) -> int:
        """Store speeds in one transaction and return their number. Batch them: commits are
        expensive.

        Raises:
            StorageMissing: a row's run does not exist (it was deleted); none of the rows is stored.
        """
        values = [asdict(row) for row in rows]
        if values:
            with self._writing() as session:
                session.execute(insert(Speed), values)
        return len(values)

    def speeds(self, run_id: str) -> list[SpeedRow]:
        """Return all speeds of a run in the order of writing; empty for an unknown run."""
        query = select(*_SPEED_COLUMNS).where(Speed.run_id == run_id).order_by(Speed.id)
        with self._reading() as session:
            return [SpeedRow(*row) for row in session.execute(query)]

    def align_run(
        self,
        run_id: str,
        alignment: JsonObject | None,
        *,
        truth_id: str | None = None,
        rows: Iterable[SpeedRow] = (),
    ) -> None:
        """Align another truth with a run, or the same one differently, in one transaction.

        Args:
            alignment: the alignment found, JSON; None removes truth and alignment.
            truth_id: the truth file; None if the truth was recorded with the run.
            rows: its speeds, which replace all speeds of the run with the source ``truth``.

        Raises:
            StorageMissing: the run or the truth does not exist; nothing was changed.
            ValueError: a row belongs to another run or another source.
        """
        values = [asdict(row) for row in rows]
        if any(row["run_id"] != run_id or row["source"] != "truth" for row in values):
            raise ValueError(
                f"an alignment of the run {run_id} must contain only ground-truth speeds"
            )
        with self._writing() as session:
            run = existing_run(session, run_id)
            run.alignment, run.truth_id = alignment, truth_id
            session.execute(delete(Speed).where(Speed.run_id == run_id, Speed.source == "truth"))
            if values:
                session.execute(insert(Speed), values)

    def append_incident(self, record: IncidentRecord) -> int:
        """Store one incident and return the number that ``append_stop`` takes.

        Raises:
            StorageMissing: its run does not exist.
        """
        values = asdict(record)
        stops = values.pop("stops")
        with self._writing() as session:
            row = Incident(**values)
            session.add(row)
            session.flush()
            session.add_all(
                IncidentStop(incident_id=row.id, role=role, **figures)
                for role, figures in stops.items()
            )
            return row.id

    def append_stop(self, incident: int, role: str, figures: StopMeasured) -> None:
        """Store the measured stop of a robot in an incident.

        Raises:
            StorageMissing: the incident does not exist (its run was deleted).
        """
        with self._writing() as session:
            session.add(IncidentStop(incident_id=incident, role=role, **asdict(figures)))

    def incidents(self, run_id: str) -> list[IncidentRecord]:
        """Return the incidents of a run, oldest first; empty for an unknown run."""
        query = select(Incident).where(Incident.run_id == run_id).order_by(Incident.id)
        of_them = select(IncidentStop).join(Incident).where(Incident.run_id == run_id)
        stops: dict[int, dict[str, StopMeasured]] = {}
        with self._reading() as session:
            for stop in session.scalars(of_them):
                stops.setdefault(stop.incident_id, {})[stop.role] = filled(StopMeasured, stop)
            return [
                filled(IncidentRecord, row, stops=stops.get(row.id, {}))
                for row in session.scalars(query)
            ]
