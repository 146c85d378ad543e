"""The server's part in a run's recording: ordering it, and feeding it the robots' states."""

from __future__ import annotations

import contextlib
import math
from collections import deque

import structlog

from app.contract.commands import RecordOrder, RecordRobots
from app.contract.robots import DriveFacts, GoalNow, RobotNow
from app.contract.values import plain
from app.server.asking import ask
from app.server.contracts import Engine
from app.server.errors import Conflict, FieldError, NotAvailable
from app.server.robots.incidents import NumberedIncident
from app.server.source_time import RisingTimes, SourceInstant, SourceTime
from app.storage import DataFolder, RunRecord, Storage, StorageError
from observer.errors import DynamicObserverError
from observer.recording import payloads
from observer.recording.payloads import RobotRow
from observer.recording.run_folder import RECORDING
from observer.recording.run_time import RunTime
from observer.rig.rig import OBSERVER, ROLES, Role

log = structlog.get_logger(__name__)

# Two robots, ten rows a second each: half a minute without an engine.
_MOST_ROWS = 600
_MOST_INCIDENTS = 100


def record_order(folder: DataFolder, run: RunRecord) -> RecordOrder | None:
    """Return the order to record a run; None if it is not recorded."""
    if run.record is None:
        return None
    return RecordOrder(
        path=str((folder.run(run.id) / RECORDING).absolute()),
        images=run.record,
        name=run.name,
        preset=run.preset,
        versions=dict(run.versions),
    )


class RobotFeed:
    """Collector of robot states until the recording takes them."""

    def __init__(self) -> None:
        self._rows: deque[RobotRow] = deque(maxlen=_MOST_ROWS)
        self._incidents: deque[payloads.Incident] = deque(maxlen=_MOST_INCIDENTS)
        self._newest: dict[str, float] = {}
        self._rising = RisingTimes()
        self._drives = False

    def heard(self, drive: DriveFacts, source: SourceTime | None) -> None:
        """Store each robot's state if it is newer than the last one, and the observer's goal.

        Args:
            drive: state of the drive process.
            source: the clock of the open source; None while that is not yet the run's source.
        """
        for role in ROLES:
            robot = drive.robots.get(role)
            if robot is None:
                continue
            received = robot.report.received
            if received is None or received <= self._newest.get(role, -math.inf):
                continue
            self._newest[role] = received
            at = None if source is None else self._rising.of(role, source.at(received))
            goal = self._goal_of_run(drive.goal) if role == OBSERVER else None
            self._rows.append(_row(role, robot, goal, at))

    def _goal_of_run(self, goal: GoalNow | None) -> GoalNow | None:
        """Return a goal while the robot drives to it, and once at its end.

        The end of an earlier goal does not belong to this run.
        """
        drove, self._drives = self._drives, goal is not None and goal.state == "driving"
        return goal if drove or self._drives else None

    def happened(self, incident: NumberedIncident) -> None:
        """Store an incident that stopped a robot."""
        self._incidents.append(
            payloads.Incident(
                kind=incident.kind,
                sentence=incident.sentence,
                received=incident.time,
                details={"role": incident.role, "speed_mps": incident.speed_mps},
            )
        )

    def take(self) -> RecordRobots | None:
        """Return the data since the last call; None if there is none."""
        if not self._rows and not self._incidents:
            return None
        request = RecordRobots(tuple(self._rows), tuple(self._incidents))
        self._rows.clear()
        self._incidents.clear()
        return request


async def tell_robots(engine: Engine, robots: RobotFeed) -> None:
    """Send the robots' states to the recording; they are lost if there is no engine."""
    request = robots.take()
    if request is not None:
        with contextlib.suppress(NotAvailable, Conflict, FieldError):
            await ask(engine, request)


def complete_recording(storage: Storage, run_id: str) -> None:
    """Add the index to an interrupted run's recording, so that every tool opens it quickly.

    The run's length is then taken from the recording: the database was last updated at some other
    time.
    """
    from observer.recording.writer import complete

    path = storage.folder.run(run_id) / RECORDING
    try:
        if path.is_file():
            complete(path)
    except DynamicObserverError as error:
        # The recording is readable without an index as well.
        log.warning("recording_not_completed", run=run_id, reason=str(error))
    measure_run(storage, run_id)


def measure_run(storage: Storage, run_id: str) -> None:
    """Store a run's length and number of frames from its recording, if there is one."""
    from observer.recording.reader import Recording

    path = storage.folder.run(run_id) / RECORDING
    try:
        if path.is_file():
            with Recording(path) as recording:
                frames = recording.frames
            time = RunTime.of_frames(frames)
            storage.measure_run(run_id, time.begin_s, time.duration_s, len(frames))
    except (DynamicObserverError, StorageError) as error:
        log.warning("run_not_measured", run=run_id, reason=str(error))


def _row(role: Role, robot: RobotNow, goal: GoalNow | None, at: SourceInstant | None) -> RobotRow:
    report, sent = robot.report, robot.sent
    received, odometry = report.received, report.odometry
    assert received is not None
    return RobotRow(
        role=role,
        received=received,
        time=None if at is None else at.time,
        sent_speed=sent.speed_mps,
        sent_turn_rate=sent.turn_rate_radps,
        encoder_speed=report.speed_mps,
        encoder_turn_rate=report.turn_rate_radps,
        x=None if odometry is None else odometry.x,
        y=None if odometry is None else odometry.y,
        yaw=None if odometry is None else odometry.yaw,
        facts={
            "state": robot.state,
            "operator": robot.operator,
            "why": robot.why,
            "battery_v": report.battery_v,
            "goal": None if goal is None else plain(goal),
        },
    )
