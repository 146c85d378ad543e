"""The run that is being kept: what of it goes into the database, and when."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import replace
from datetime import datetime, timedelta
from functools import partial
from typing import Any, ClassVar

from app.contract.events import ObservationEvent
from app.contract.robots import Robots, StopMeasured
from app.server.robots.incidents import Incident
from app.server.robots.wheels import WheelSample
from app.server.runs.pending_rows import PendingRows
from app.server.runs.recording import RobotFeed
from app.server.writer import Writer
from app.storage import (
    IncidentRecord,
    RunRecord,
    RunState,
    SpeedRow,
    Storage,
    StorageMissing,
)
from observer.rig.rig import Role

# At most this much is lost when the machine stops.
_FLUSH_S = 0.5


class CurrentRun:
    """Collects a run's rows and hands them to the writer twice a second.

    Args:
        record: as it was created.
        clock: monotonic seconds.

    Attributes:
        most_rows: that wait for the database, the newest; a quarter of an hour, or some 20 MB.
        programme: whether it began with one, which then ends with it.
        robots: what the recording is to be told of them.
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
        self._storage = storage
        self._writer = writer
        self._clock = clock
        self._rows = PendingRows(self.most_rows)
        # Whether a write is queued, or tried again: it takes what comes meanwhile as well.
        self._asked = False
        self._began = self._flushed = clock()
        # What the database calls each incident; of the writer's thread alone.
        self._incidents: dict[int, int] = {}

    @property
    def id(self) -> str:
        return self.record.id

    def observed(self, event: ObservationEvent, driven: Collection[str] = ()) -> None:
        """Keep what one frame said of speeds.

        Args:
            driven: roles whose commands are told by ``measured``.
        """
        self.frames += 1
        self.segments = max(self.segments, int(event.line["segment"]) + 1)
        self._collect(speed_rows(self.id, event, driven))

    def measured(self, sample: WheelSample) -> None:
        """Keep what a robot was sent and what its wheels said."""
        # Before its first frame the newest one is of what was open before, on another clock.
        if self.frames:
            self._collect(wheel_rows(self.id, sample))

    def heard(self, robots: Robots, newest: ObservationEvent | None) -> None:
        """Have recorded how robots are; see ``RobotFeed.heard``."""
        if self.record.record is not None:
            self.robots.heard(robots, newest if self.frames else None)

    def _collect(self, rows: Iterable[SpeedRow]) -> None:
        self._rows.add(rows)
        if self._clock() - self._flushed >= _FLUSH_S:
            self.flush()

    def happened(self, incident: Incident) -> None:
        """Keep that something stopped a robot."""
        record = IncidentRecord(
            self.id, incident.at, incident.role, incident.kind, incident.sentence,
            incident.speed_mps,
        )  # fmt: skip
        self._writer.post(partial(self._write_incident, incident.number, record))
        if self.record.record is not None:
            self.robots.happened(incident)

    def stopped(self, incident: Incident, role: Role) -> None:
        """Keep how a robot came to stand by it; also behind the end of the run."""
        self._writer.post(partial(self._write_stop, incident.number, role, incident.stops[role]))

    def flush(self) -> None:
        """Have the rows so far written; where that is not possible now, with the next ones."""
        self._flushed = self._clock()
        if not self._asked:
            self._asked = self._writer.post(self._write, self._wrote)

    def now(self) -> str:
        """The time of day by the clock that never jumps, from the run's beginning on."""
        passed = timedelta(seconds=self._clock() - self._began)
        began = datetime.fromisoformat(self.record.started_at)
        return (began + passed).isoformat(timespec="microseconds")

    def snapshot(self) -> RunRecord:
        """The record as it stands now."""
        return replace(
            self.record, frames=self.frames, segments=self.segments, updated_at=self.now()
        )

    def ended(self, state: RunState, reason: str | None) -> RunRecord:
        """The record of the run's end."""
        now = self.now()
        if reason is None and self._rows.lost:
            reason = (
                f"the database did not take what was observed for so long that "
                f"{self._rows.lost} speeds were lost"
            )
        return replace(self.snapshot(), state=state, reason=reason, updated_at=now, ended_at=now)

    def write_end(self, ended: RunRecord, recording_bytes: int | None) -> RunRecord:
        """Write the run's last rows and its end; in the writer's thread.

        Args:
            ended: as ``ended`` made it.

        Raises:
            StorageError: what could not be written stays for the next time.
        """
        self._write()
        return self._storage.update_run(
            self.id,
            state=ended.state,
            frames=ended.frames,
            segments=ended.segments,
            reason=ended.reason,
            recording_bytes=recording_bytes,
            at=ended.ended_at,
        )

    def _write(self) -> None:
        # Both are tried again where one finds the database locked, so what must not be done twice
        # comes last.
        rows = self._rows.take()
        try:
            self._storage.update_run(
                self.id, frames=self.frames, segments=self.segments, at=self.now()
            )
            self._storage.append_speeds(rows)
        except StorageMissing:
            # Of a run that is no more nothing is kept.
            raise
        except BaseException:
            self._rows.give_back(rows)
            raise

    def _wrote(self, value: object, error: BaseException | None) -> None:
        """Its rows are written, or wait again."""
        del value, error
        self._asked = False

    def _write_incident(self, number: int, record: IncidentRecord) -> None:
        self._incidents[number] = self._storage.append_incident(record)

    def _write_stop(self, number: int, role: Role, figures: StopMeasured) -> None:
        incident = self._incidents.get(number)
        # None: the incident could not be written, which was told then.
        if incident is not None:
            self._storage.append_stop(incident, role, figures)


def speed_rows(
    run_id: str, event: ObservationEvent, driven: Collection[str] = ()
) -> Iterator[SpeedRow]:
    """The rows of one observation: estimates, truth and commands, each where there is one.

    A coasting obstacle was not seen, so its speed is a gap. The commands of ``driven`` roles come
    from the drive process, so the truth's are left out.
    """
    line = event.line
    segment = int(line["segment"])

    def row(time: float, role: str, source: Any, track: int, speed: Any, std: Any) -> SpeedRow:
        return SpeedRow(run_id, float(time), role, source, track, speed, std, segment)

    for obstacle in line["obstacles"]:
        seen = obstacle["state"] == "confirmed"
        yield row(
            obstacle["velocity_time"],
            "obstacle",
            "estimate",
            int(obstacle["id"]),
            obstacle["speed"] if seen else None,
            obstacle["speed_std"] if seen else None,
        )
    for body in event.truth:
        identity, role = int(body["id"]), str(body["role"])
        # Live motion capture tells the instant that was measured, which may be before the frame.
        measured = body.get("time", line["time"])
        told = row(measured, role, "truth", identity, body["speed"], None)
        yield replace(told, body=body.get("name"))
        if body["commanded_speed"] is not None and role not in driven:
            yield row(line["time"], role, "commanded", identity, body["commanded_speed"], None)


def wheel_rows(run_id: str, sample: WheelSample) -> Iterator[SpeedRow]:
    """What was sent, and what the encoders said where they say anything."""
    yield SpeedRow(
        run_id, sample.time, sample.role, "commanded", None, sample.sent_mps, None, sample.segment
    )
    if sample.encoder_mps is not None:
        yield SpeedRow(
            run_id, sample.time, sample.role, "encoder", None, sample.encoder_mps, None,
            sample.segment,
        )  # fmt: skip
