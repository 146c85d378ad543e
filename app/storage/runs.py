"""Runs and the speeds observed in them."""

from __future__ import annotations

import secrets
from collections.abc import Iterable
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any, cast

from sqlalchemy import delete, insert, select

from app.storage.database import Database
from app.storage.errors import StorageMissing
from app.storage.models import Incident, IncidentStop, Run, Speed
from app.storage.records import (
    IncidentRecord,
    RunRecord,
    RunState,
    SpeedRow,
    SpeedSource,
    StopFigures,
    utc_now,
)

_SPEED_COLUMNS = (
    Speed.run_id,
    Speed.time,
    Speed.role,
    Speed.source,
    Speed.track_id,
    Speed.speed,
    Speed.std,
    Speed.segment,
)


class RunTables(Database):
    """A run is made ``running`` and ends in one of the other states of ``RunState``."""

    def create_run(
        self,
        *,
        name: str,
        source: str,
        parameters: dict[str, Any],
        versions: dict[str, str],
        calibration_id: str | None = None,
        preset: str | None = None,
    ) -> RunRecord:
        """Begin a run; its id sorts by time and is fit for a file name.

        Raises:
            StorageMissing: the calibration was not saved before.
        """
        now = utc_now()
        row = Run(
            id=f"{datetime.now(UTC):%Y%m%d-%H%M%S}-{secrets.token_hex(3)}",
            name=name,
            state=RunState.RUNNING.value,
            source=source,
            calibration_id=calibration_id,
            preset=preset,
            parameters=dict(parameters),
            started_at=now,
            updated_at=now,
            ended_at=None,
            frames=0,
            segments=1,
            versions=dict(versions),
            reason=None,
        )
        with self._writing() as session:
            session.add(row)
            return _run(row)

    def update_run(
        self,
        run_id: str,
        *,
        name: str | None = None,
        state: RunState | None = None,
        frames: int | None = None,
        segments: int | None = None,
        reason: str | None = None,
        calibration_id: str | None = None,
    ) -> RunRecord:
        """Change what is given, and note the sign of life; a final state also notes the end.

        Raises:
            StorageMissing: there is no such run.
        """
        now = utc_now()
        given = {
            "name": name,
            "frames": frames,
            "segments": segments,
            "reason": reason,
            "calibration_id": calibration_id,
        }
        with self._writing() as session:
            row = session.get(Run, run_id)
            if row is None:
                raise StorageMissing(f"there is no run {run_id}; GET /api/runs lists them")
            for field, value in given.items():
                if value is not None:
                    setattr(row, field, value)
            row.updated_at = now
            if state is not None:
                row.state = state.value
                row.ended_at = None if state is RunState.RUNNING else now
            return _run(row)

    def get_run(self, run_id: str) -> RunRecord | None:
        with self._reading() as session:
            row = session.get(Run, run_id)
            return None if row is None else _run(row)

    def list_runs(self, *, limit: int = 200, offset: int = 0) -> list[RunRecord]:
        """Newest first."""
        query = (
            select(Run).order_by(Run.started_at.desc(), Run.id.desc()).limit(limit).offset(offset)
        )
        with self._reading() as session:
            return [_run(row) for row in session.scalars(query)]

    def delete_run(self, run_id: str) -> bool:
        """Forget a run with its speeds and parameter revisions; False when there was none."""
        with self._writing() as session:
            row = session.get(Run, run_id)
            if row is None:
                return False
            # The database deletes what refers to it.
            session.execute(delete(Run).where(Run.id == run_id))
            return True

    def mark_interrupted_runs(
        self, reason: str = "the server ended before the run did"
    ) -> list[RunRecord]:
        """At the server's start: no run can be running, so those that say so were interrupted.

        They end at their last sign of life. Returns them.
        """
        with self._writing() as session:
            rows = list(session.scalars(select(Run).where(Run.state == RunState.RUNNING.value)))
            for row in rows:
                row.state = RunState.INTERRUPTED.value
                row.ended_at = row.updated_at
                row.reason = reason
            return [_run(row) for row in rows]

    def append_speeds(self, rows: Iterable[SpeedRow]) -> int:
        """Keep speeds in one transaction; returns how many. Batch them: a commit costs most.

        Raises:
            StorageMissing: a row's run is not there (it was deleted); none of the rows is kept.
        """
        values = [asdict(row) for row in rows]
        if values:
            with self._writing() as session:
                session.execute(insert(Speed), values)
        return len(values)

    def speeds(self, run_id: str) -> list[SpeedRow]:
        """All speeds of a run in the order of writing; empty for an unknown run."""
        query = select(*_SPEED_COLUMNS).where(Speed.run_id == run_id).order_by(Speed.id)
        with self._reading() as session:
            return [
                SpeedRow(
                    run_id=row.run_id,
                    time=row.time,
                    role=row.role,
                    source=cast(SpeedSource, row.source),
                    track_id=row.track_id,
                    speed=row.speed,
                    std=row.std,
                    segment=row.segment,
                )
                for row in session.execute(query)
            ]

    def append_incident(self, record: IncidentRecord) -> int:
        """Keep one incident; returns the number by which ``append_stop`` knows it.

        Raises:
            StorageMissing: its run is not there.
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

    def append_stop(self, incident: int, role: str, figures: StopFigures) -> None:
        """Keep how a robot that an incident stopped came to stand.

        Raises:
            StorageMissing: the incident is not there (its run was deleted).
        """
        with self._writing() as session:
            session.add(IncidentStop(incident_id=incident, role=role, **asdict(figures)))

    def incidents(self, run_id: str) -> list[IncidentRecord]:
        """Those of a run, oldest first; empty for an unknown run."""
        query = select(Incident).where(Incident.run_id == run_id).order_by(Incident.id)
        of_them = select(IncidentStop).join(Incident).where(Incident.run_id == run_id)
        stops: dict[int, dict[str, StopFigures]] = {}
        with self._reading() as session:
            for stop in session.scalars(of_them):
                figures = StopFigures(
                    zero_ms=stop.zero_ms,
                    stood_ms=stop.stood_ms,
                    distance_m=stop.distance_m,
                    speed_mps=stop.speed_mps,
                    separation_m=stop.separation_m,
                )
                stops.setdefault(stop.incident_id, {})[stop.role] = figures
            return [
                IncidentRecord(
                    row.run_id,
                    row.at,
                    row.role,
                    row.kind,
                    row.sentence,
                    row.speed_mps,
                    stops.get(row.id, {}),
                )
                for row in session.scalars(query)
            ]


def _run(row: Run) -> RunRecord:
    return RunRecord(
        id=row.id,
        name=row.name,
        state=RunState(row.state),
        source=row.source,
        calibration_id=row.calibration_id,
        preset=row.preset,
        parameters=row.parameters,
        started_at=row.started_at,
        updated_at=row.updated_at,
        ended_at=row.ended_at,
        frames=row.frames,
        segments=row.segments,
        versions=row.versions,
        reason=row.reason,
    )
