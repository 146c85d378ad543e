"""The run in progress: its rows for the database, and when they are written."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import replace
from datetime import datetime, timedelta
from functools import partial
from typing import ClassVar

from app.contract.events import ObservationEvent
from app.contract.robots import DriveFacts, StopMeasured
from app.contract.runs import SpeedSource
from app.contract.values import filled
from app.server.robots.incidents import NumberedIncident
from app.server.robots.wheels import WheelSample
from app.server.runs.pending_rows import PendingRows
from app.server.runs.recording import RobotFeed
from app.server.source_time import SourceTime
from app.server.writer import Writer
from app.storage import (
    IncidentRecord,
    RunRecord,
    RunState,
    SpeedRow,
    Storage,
    StorageMissing,
)
from app.workers.frame_results import FrameResult, frame_result
from observer.recording.run_time import RunTime
from observer.rig.rig import Role

# At most this much is lost when the machine stops.
_FLUSH_S = 0.5


class CurrentRun:
    """Collector of a run's rows that passes them to the writer twice a second.

    Args:
        record: the record as created.
        clock: monotonic seconds.

    Attributes:
        most_rows: limit of waiting rows, beyond which the oldest are dropped; a quarter of an hour,
            or some 20 MB.
        programme: whether the run began with a programme, which then ends with it.
        robots: robot states for the recording.
        time: the run's clock and length.
    """

    most_rows: ClassVar[int] = 100_000

    def __init__(
        self, record: RunRecord, storage: Storage, writer: Writer, clock: Callable[[], float]
    ) -> None:
        self.record = record
        self.frames = 0
        self.segments = 1
        self.programme = False
        self.robots = RobotFeed()
        self.time = RunTime()
        # Number of times a new engine continued the run, and whether its first frame is still due.
        self.replaced = 0
        self._reopened = False
        self._storage = storage
        self._writer = writer
        self._clock = clock
        self._rows = PendingRows(self.most_rows)
        # Whether a write is queued or being retried; it will include rows that arrive meanwhile.
        self._asked = False
        self._began = self._flushed = clock()
        # The database's number of each incident; used only in the writer's thread.
        self._incidents: dict[int, int] = {}

    @property
    def id(self) -> str:
        return self.record.id

    def observed(self, event: ObservationEvent, driven: Collection[str] = ()) -> None:
        """Store the speeds of one frame.

        Args:
            driven: roles whose commanded speeds come through ``measured``.
        """
        self.frames += 1
        line = event.line
        self.segments = max(self.segments, line["segment"] + 1)
        self.time.add(line["time"], event.received, reopened=self._reopened)
        self._reopened = False
        seen = frame_result(line, event.truth, self.time.offset_s)
        self._collect(speed_rows(self.id, seen, driven))

    def resumed(self, segment: int) -> None:
        """Continue with a new engine, which has reopened the source, as this segment."""
        self.segments = max(self.segments, segment + 1)
        self.replaced += 1
        self._reopened = True

    def measured(self, sample: WheelSample) -> None:
        """Store the commanded and measured wheel speeds of a robot."""
        # Before the run's first frame the source's clock is still that of the previous source.
        if self.frames:
            self._collect(wheel_rows(self.id, sample, self.time.offset_s))

    def heard(self, facts: DriveFacts, source: SourceTime) -> None:
        """Record the robots' states and the goal; see ``RobotFeed.heard``."""
        if self.record.record is not None:
            self.robots.heard(facts, source if self.frames else None)

    def _collect(self, rows: Iterable[SpeedRow]) -> None:
        self._rows.add(rows)
        if self._clock() - self._flushed >= _FLUSH_S:
            self.flush()

    def happened(self, incident: NumberedIncident) -> None:
        """Store an incident that stopped a robot."""
        record = filled(IncidentRecord, incident, run_id=self.id)
        self._writer.post(partial(self._write_incident, incident.number, record))
        if self.record.record is not None:
            self.robots.happened(incident)

    def stopped(self, incident: NumberedIncident, role: Role) -> None:
        """Store how a robot stopped in an incident; this also works after the end of the run."""
        self._writer.post(partial(self._write_stop, incident.number, role, incident.stops[role]))

    def flush(self) -> None:
        """Write the rows so far; if that is impossible now, they are written with the next ones."""
        self._flushed = self._clock()
        if not self._asked:
            # Set beforehand: the writer's thread may end the write before ``post`` returns.
            self._asked = True
            if not self._writer.post(self._write, self._wrote):
                self._asked = False

    def now(self) -> str:
        """Return the time of day: the run's start plus the monotonic time since."""
        passed = timedelta(seconds=self._clock() - self._began)
        began = datetime.fromisoformat(self.record.started_at)
        return (began + passed).isoformat(timespec="microseconds")

    def snapshot(self) -> RunRecord:
        """Return the record in its present state."""
        return replace(
            self.record,
            frames=self.frames,
            segments=self.segments,
            begin_s=self.time.begin_s,
            duration_s=self.time.duration_s,
            updated_at=self.now(),
        )

    def ended(self, state: RunState, reason: str | None) -> RunRecord:
        """Return the record of the run's end."""
        now = self.now()
        if reason is None and self._rows.lost:
            reason = (
                f"the database was unavailable for so long that {self._rows.lost} speeds were lost"
            )
        return replace(self.snapshot(), state=state, reason=reason, updated_at=now, ended_at=now)

    def write_end(self, ended: RunRecord, recording_bytes: int | None) -> RunRecord:
        """Write the run's last rows and its end; in the writer's thread.

        Args:
            ended: the result of ``ended``.

        Raises:
            StorageError: rows that could not be written are kept for the next attempt.
        """
        self._write()
        return self._storage.update_run(
            self.id,
            state=ended.state,
            frames=ended.frames,
            segments=ended.segments,
            begin_s=ended.begin_s,
            duration_s=ended.duration_s,
            reason=ended.reason,
            recording_bytes=recording_bytes,
            at=ended.ended_at,
        )

    def _write(self) -> None:
        # Both calls are repeated if one finds the database locked, so the one that must not run
        # twice comes last.
        rows = self._rows.take()
        try:
            self._storage.update_run(
                self.id,
                frames=self.frames,
                segments=self.segments,
                begin_s=self.time.begin_s,
                duration_s=self.time.duration_s,
                at=self.now(),
            )
            self._storage.append_speeds(rows)
        except StorageMissing:
            # A deleted run stores nothing.
            raise
        except BaseException:
            self._rows.give_back(rows)
            raise

    def _wrote(self, value: object, error: BaseException | None) -> None:
        """Note the end of a write: its rows are stored or were put back."""
        del value, error
        self._asked = False

    def _write_incident(self, number: int, record: IncidentRecord) -> None:
        self._incidents[number] = self._storage.append_incident(record)

    def _write_stop(self, number: int, role: Role, figures: StopMeasured) -> None:
        incident = self._incidents.get(number)
        # None: the incident itself could not be written, which has been reported.
        if incident is not None:
            self._storage.append_stop(incident, role, figures)


def speed_rows(run_id: str, frame: FrameResult, driven: Collection[str] = ()) -> Iterator[SpeedRow]:
    """Yield the rows of one frame: estimates, truth and commands, as far as present.

    A coasting obstacle was not seen, so its speed is None. The drive process supplies the commands
    of ``driven`` roles, so the truth's commands for these are left out.
    """

    def row(
        time: float,
        role: str,
        source: SpeedSource,
        track: int,
        speed: float | None,
        std: float | None = None,
        body: str | None = None,
    ) -> SpeedRow:
        time += frame.offset_s
        return SpeedRow(run_id, time, role, source, track, speed, std, frame.segment, body)

    for obstacle in frame.obstacles:
        seen = obstacle["state"] == "confirmed"
        yield row(
            obstacle["velocity_time"],
            "obstacle",
            "estimate",
            obstacle["id"],
            obstacle["speed"] if seen else None,
            obstacle["speed_std"] if seen else None,
        )
    for body in frame.truth:
        identity, role, commanded = body["id"], body["role"], body["commanded_speed"]
        # Live motion capture gives the time of the measurement, which may be before the frame.
        measured = body.get("time", frame.time)
        yield row(measured, role, "truth", identity, body["speed"], body=body["name"])
        if commanded is not None and role not in driven:
            yield row(frame.time, role, "commanded", identity, commanded)


def wheel_rows(run_id: str, sample: WheelSample, offset_s: float = 0.0) -> Iterator[SpeedRow]:
    """Yield the rows of a sample: the command, and the encoder speed if there is one."""
    speeds: dict[SpeedSource, float | None] = {
        "commanded": sample.sent_mps,
        "encoder": sample.encoder_mps,
    }
    for source, speed in speeds.items():
        if speed is not None:
            yield SpeedRow(
                run_id,
                sample.time + offset_s,
                sample.role,
                source,
                None,
                speed,
                None,
                sample.segment,
            )
