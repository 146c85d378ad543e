"""Runs: creation, changes, search, annotation, deletion with undo."""

from __future__ import annotations

import re
import secrets
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta

from sqlalchemy import func, select
from sqlalchemy.orm import Session, object_session

from app.contract.parameters import ParameterValues
from app.contract.values import filled
from app.storage.database import Database
from app.storage.errors import StorageMissing
from app.storage.models import Run, RunTag
from app.storage.records import RunPage, RunRecord, RunState, mapping, utc_now
from app.storage.searching import folded, matching
from observer.parameters import translated
from observer.recording.payloads import Images

# Time during which a deletion can be undone.
UNDO = timedelta(days=7)
_DAMAGED = "the {} of this run {} damaged in the database and cannot be read"
# The recording of a run, or a clip that was saved during it, by its present or former name.
_RECORDED = re.compile(r"(?:.*/)?runs/([^/]+)/(recording|(?:clip|ring)-[\d-]+)\.mcap")
_NEWEST_FIRST = (Run.started_at.desc(), Run.id.desc())


def new_run_id() -> str:
    """Return the id of a new run, which sorts by time and is valid as a file name."""
    return f"{datetime.now(UTC):%Y%m%d-%H%M%S}-{secrets.token_hex(3)}"


class RunTables(Database):
    """Table of runs. A run begins as ``running`` and ends in another state of ``RunState``.

    A method that changes a run raises ``StorageMissing`` if there is none.
    """

    def create_run(
        self,
        *,
        id: str | None = None,
        name: str,
        source: str,
        parameters: ParameterValues,
        versions: dict[str, str],
        calibration_id: str | None = None,
        preset: str | None = None,
        rig: str | None = None,
        record: Images | None = None,
        truth_id: str | None = None,
        rerun_of: str | None = None,
        tags: Iterable[str] = (),
        notes: str = "",
    ) -> RunRecord:
        """Create a run.

        Args:
            id: as of ``new_run_id``; None for a new one.

        Raises:
            StorageMissing: the calibration or the truth is not stored.
        """
        now = utc_now()
        row = Run(
            id=id or new_run_id(),
            name=name,
            state=RunState.RUNNING.value,
            source=source,
            calibration_id=calibration_id,
            preset=preset,
            parameters=dict(parameters),
            started_at=now,
            updated_at=now,
            frames=0,
            segments=1,
            versions=dict(versions),
            notes=notes,
            rig=rig,
            record=record,
            truth_id=truth_id,
            rerun_of=rerun_of,
            tags=_tags(tags),
        )
        row.searched = _searched(row)
        with self._writing() as session:
            session.add(row)
            session.flush()
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
        recording_bytes: int | None = None,
        begin_s: float | None = None,
        duration_s: float | None = None,
        at: str | None = None,
    ) -> RunRecord:
        """Change the given values and record a heartbeat; a final state also records the end.

        Args:
            at: time of the change, as from ``utc_now``; None: now.
        """
        now = at or utc_now()
        given = {
            "name": name,
            "frames": frames,
            "segments": segments,
            "reason": reason,
            "calibration_id": calibration_id,
            "recording_bytes": recording_bytes,
            "begin_s": begin_s,
            "duration_s": duration_s,
        }
        with self._writing() as session:
            row = existing_run(session, run_id)
            for field, value in given.items():
                if value is not None:
                    setattr(row, field, value)
            if name is not None:
                row.searched = _searched(row)
            row.updated_at = now
            if state is not None:
                row.state = state.value
                row.ended_at = None if state is RunState.RUNNING else now
            return _run(row)

    def measure_run(
        self, run_id: str, begin_s: float | None, duration_s: float | None, frames: int
    ) -> None:
        """Store the length and the number of frames of a run, as found in its recording.

        Unlike ``update_run``, this is no heartbeat.
        """
        with self._writing() as session:
            row = existing_run(session, run_id)
            row.begin_s, row.duration_s, row.frames = begin_s, duration_s, frames

    def unmeasured_runs(self) -> list[str]:
        """Return the ids of ended runs with frames whose length was never kept, newest first."""
        query = select(Run.id).where(
            Run.duration_s.is_(None), Run.frames > 0, Run.state != RunState.RUNNING.value
        )
        with self._reading() as session:
            return list(session.scalars(query.order_by(*_NEWEST_FIRST)))

    def annotate_run(
        self,
        run_id: str,
        *,
        name: str | None = None,
        tags: Iterable[str] | None = None,
        notes: str | None = None,
    ) -> RunRecord:
        """Change a user's annotations of a run; unlike ``update_run``, this is no heartbeat.

        Args:
            tags: all tags, replacing the previous ones; surrounding space is removed.
        """
        with self._writing() as session:
            row = existing_run(session, run_id)
            if name is not None:
                row.name = name
            if notes is not None:
                row.notes = notes
            if tags is not None:
                kept = {each.tag: each for each in row.tags}
                row.tags = [kept.get(each.tag, each) for each in _tags(tags)]
            row.searched = _searched(row)
            return _run(row)

    def get_run(self, run_id: str) -> RunRecord | None:
        """Return one run, including one that can still be recovered."""
        with self._reading() as session:
            row = session.get(Run, run_id)
            return None if row is None else _run(row)

    def recording_name(self, source: str) -> str | None:
        """Return what people call a source that is a run's recording, or a clip of it.

        None for every other source, and if there is no such run.
        """
        with self._reading() as session:
            return _recording_name(session, source)

    def list_runs(self, *, limit: int = 200, offset: int = 0) -> list[RunRecord]:
        """Return runs, newest first, without deleted ones."""
        return list(self.find_runs(limit=limit, offset=offset).runs)

    def find_runs(
        self,
        text: str = "",
        *,
        tags: Iterable[str] = (),
        deleted: bool = False,
        limit: int = 50,
        offset: int = 0,
    ) -> RunPage:
        """Return runs, newest first, with every word in name, notes or tags, and with every tag.

        Args:
            deleted: recoverable runs instead of the others.
        """
        wanted = matching(text, tags, deleted)
        query = select(Run).where(wanted).order_by(*_NEWEST_FIRST).limit(limit).offset(offset)
        with self._reading() as session:
            total = session.scalar(select(func.count()).select_from(Run).where(wanted))
            return RunPage(tuple(map(_run, session.scalars(query))), total or 0)

    def run_tags(self) -> dict[str, int]:
        """Return every tag with its number of runs, without deleted ones; sorted by tag."""
        query = (
            select(RunTag.tag, func.count())
            .join(Run, Run.id == RunTag.run_id)
            .where(Run.deleted_at.is_(None))
            .group_by(RunTag.tag)
        )
        with self._reading() as session:
            # Sorted here: databases order text by their locale.
            return dict(sorted((tag, count) for tag, count in session.execute(query)))

    def discard_run(self, run_id: str) -> RunRecord:
        """Hide a run; ``recover_run`` restores it until it is purged."""
        with self._writing() as session:
            row = existing_run(session, run_id)
            row.deleted_at = row.deleted_at or utc_now()
            return _run(row)

    def recover_run(self, run_id: str) -> RunRecord:
        """Undo ``discard_run``.

        Raises:
            StorageMissing: there is no such run any more.
        """
        with self._writing() as session:
            row = existing_run(session, run_id)
            row.deleted_at = None
            return _run(row)

    def delete_run(self, run_id: str) -> bool:
        """Permanently delete a run with its rows and its folder; return False if there was none.

        Raises:
            StorageError: its files cannot be deleted; the run stays.
        """
        if self.get_run(run_id) is None:
            return False
        # Gigabytes are not deleted within a transaction. Rows without files are found and deleted
        # again; files without rows would stay forever.
        self.folder.remove_run(run_id)
        with self._writing() as session:
            row = session.get(Run, run_id)
            if row is not None:
                session.delete(row)
            return row is not None

    def purge_runs(self, older_than: timedelta) -> list[str]:
        """Permanently delete runs that were discarded long enough ago; return their ids."""
        before = datetime.now(UTC) - older_than
        query = select(Run.id).where(Run.deleted_at <= before.isoformat(timespec="microseconds"))
        with self._reading() as session:
            gone = list(session.scalars(query.order_by(Run.id)))
        for run_id in gone:
            self.delete_run(run_id)
        self.folder.tidy()
        return gone

    def mark_interrupted_runs(self) -> list[RunRecord]:
        """Mark all running runs as interrupted, at the server's start: none can be running then.

        They end at their last heartbeat, with what was recorded until then. Returns them.
        """
        with self._writing() as session:
            rows = list(session.scalars(select(Run).where(Run.state == RunState.RUNNING.value)))
            for row in rows:
                row.state = RunState.INTERRUPTED.value
                row.ended_at = row.updated_at
                row.reason = "the server stopped during the run"
                row.recording_bytes = self.folder.recording_bytes(row.id)
            return [_run(row) for row in rows]


def _run(row: Run) -> RunRecord:
    unknown = None if isinstance(row.parameters, dict) else _DAMAGED.format("parameters", "are")
    reason = row.reason or unknown
    try:
        state = RunState(row.state)
    except ValueError:
        state, reason = RunState.FAILED, _DAMAGED.format("state", "is")
    return filled(
        RunRecord,
        row,
        state=state,
        parameters=translated(mapping(row.parameters)),
        versions={name: str(version) for name, version in mapping(row.versions).items()},
        alignment=None if row.alignment is None else mapping(row.alignment),
        recording_name=_recording_name(object_session(row), row.source),
        reason=reason,
        # Sorted here: databases order text by their locale.
        tags=tuple(sorted(each.tag for each in row.tags)),
    )


def _recording_name(session: Session | None, source: str) -> str | None:
    found = _RECORDED.fullmatch(source)
    run = None if found is None or session is None else session.get(Run, found[1])
    if run is None or found is None:
        return None
    return f"Recording of {run.name}" if found[2] == "recording" else f"Saved clip of {run.name}"


def existing_run(session: Session, run_id: str) -> Run:
    """Return a run's row within a caller's transaction.

    Raises:
        StorageMissing: there is no such run.
    """
    row = session.get(Run, run_id)
    if row is None:
        raise StorageMissing(f"there is no run {run_id}; it may have been deleted")
    return row


def _tags(tags: Iterable[str]) -> list[RunTag]:
    return [RunTag(tag=tag) for tag in sorted({each.strip() for each in tags} - {""})]


def _searched(row: Run) -> str:
    return folded(row.name, row.notes, *(each.tag for each in row.tags))
