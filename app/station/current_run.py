"""The run that is being kept: what of it goes into the database, and when."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from datetime import datetime, timedelta
from functools import partial
from typing import Any

from app.messages import ObservationEvent
from app.station.driving.incidents import Incident
from app.station.driving.wheels import WheelSample
from app.station.run_recording import RobotFeed
from app.station.writer import Writer
from app.storage import (
    IncidentRecord,
    RunRecord,
    RunState,
    SpeedRow,
    StopFigures,
    Storage,
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
        programme: whether it began with one, which then ends with it.
        robots: what the recording is to be told of them.
    """

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
        self._rows: list[SpeedRow] = []
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
        self._collect(wheel_rows(self.id, sample))

    def heard(self, robots: Mapping[str, Any], newest: ObservationEvent | None) -> None:
        """Have recorded how robots are; see ``RobotFeed.heard``."""
        if self.record.record is not None:
            self.robots.heard(robots, newest)

    def _collect(self, rows: Iterable[SpeedRow]) -> None:
        self._rows.extend(rows)
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
        self._writer.post(
            partial(self._write_stop, incident.number, role, incident.stops[role])
        )

    def flush(self) -> None:
        """Give the rows so far to the writer."""
        rows, self._rows = self._rows, []
        self._flushed = self._clock()
        self._writer.post(partial(self._write, rows, self.frames, self.segments, self.now()))

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
        return replace(self.snapshot(), state=state, reason=reason, updated_at=now, ended_at=now)

    def _write(self, rows: list[SpeedRow], frames: int, segments: int, at: str) -> None:
        # Both are tried again where one finds the database locked, so what must not be done twice
        # comes last.
        self._storage.update_run(self.id, frames=frames, segments=segments, at=at)
        self._storage.append_speeds(rows)

    def _write_incident(self, number: int, record: IncidentRecord) -> None:
        self._incidents[number] = self._storage.append_incident(record)

    def _write_stop(self, number: int, role: Role, figures: StopFigures) -> None:
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
        yield row(line["time"], role, "truth", identity, body["speed"], None)
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
