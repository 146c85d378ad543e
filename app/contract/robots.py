"""Robots, their guided check and programmes, as reported to clients."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from app.contract.parameters import ParameterValues
from app.contract.values import means
from observer.guard.guard import Level
from observer.motion_profiles.playing import Phase
from observer.navigation.plan import RefusedPath
from observer.rig.rig import Role
from observer.robots.contract import RobotReport

CheckOutcome = Literal["passed", "failed", "incomplete", "given_up"]


@dataclass(frozen=True)
class Latch:
    by: str
    since: Annotated[float, means("The host's monotonic clock, s.")]


@dataclass(frozen=True)
class DriveProcess:
    alive: bool
    pid: int | None
    restarts: int
    trouble: Annotated[str | None, means("Why nothing can be driven, one sentence.")]


@dataclass(frozen=True)
class Velocity:
    speed_mps: float
    turn_rate_radps: float


@dataclass(frozen=True)
class GuardVerdict:
    """Velocity that the guard permits; zones are corners in the robot's base frame, metres."""

    level: Level
    reason: str | None
    limit_mps: Annotated[float | None, means("Maximum speed along the current arc.")]
    stop_zone: Sequence[tuple[float, float]]
    slow_zone: Sequence[tuple[float, float]]


@dataclass(frozen=True)
class SightNow:
    """The newest frame known to the drive process."""

    age_s: float | None
    status: str | None
    world: str | None


@dataclass(frozen=True)
class DriveLoopFacts:
    """Punctuality of the drive loop, and what it could not report."""

    ticks: int
    late_p99_ms: float | None
    late_max_ms: float | None
    priority: str
    wheel_speeds_lost: Annotated[int, means("Wheel speeds dropped because the server was busy.")]


@dataclass(frozen=True)
class ProgrammeNow:
    """Programme in progress."""

    name: str
    phase: Phase
    round: Annotated[int, means("Current repetition, from 1 to repeat.")]
    elapsed_s: float
    duration_s: float
    repeat: int
    reverse: bool


GoalState = Literal["driving", "reached", "ended"]


@dataclass(frozen=True)
class GoalNow:
    """Goal to which the observer drives, or drove last. Places are metres ahead of the robot and
    to its left, as it stands now."""

    state: GoalState
    sentence: Annotated[str, means("What the robot does and why, or why it ended.")]
    place: Annotated[tuple[float, float] | None, means("null: no longer known.")]
    distance_m: float | None
    elapsed_s: float
    path: Annotated[Sequence[tuple[float, float]], means("Path planned for the next seconds.")]
    risk_per_metre: Annotated[
        float, means("Declared risk of a contact with tracked obstacles, per metre driven.")
    ]
    planned_risk_per_metre: Annotated[
        float | None, means("Risk of the planned path until the robot could stop.")
    ]
    waits_for: Annotated[
        int | None, means("Track for which it stops or swerves; negative: not numbered yet.")
    ]
    meets_s: Annotated[float | None, means("Time until it would meet that track, s.")]
    meets_at: Annotated[
        tuple[float, float] | None, means("Predicted position of that track at that time.")
    ] = None
    refused: Annotated[
        Sequence[RefusedPath], means("Some of the rejected paths, the best one first.")
    ] = ()


RobotState = Literal["connecting", "disarmed", "armed", "moving", "waiting", "refused"]
# Those in which a robot takes commands: it stands still or drives.
DRIVEN_STATES = ("armed", "moving")


@dataclass(frozen=True)
class RobotNow:
    """One robot that is connected or to be connected."""

    port: str
    name: str | None
    world: str
    state: RobotState
    operator: str | None
    present: bool
    why: Annotated[str | None, means("Why it does not move as asked, or is disarmed.")]
    commanded: Annotated[Velocity, means("Requested velocity.")]
    sent: Annotated[Velocity, means("Velocity actually sent.")]
    guard: GuardVerdict | None
    report: Annotated[RobotReport, means("Report of the robot, SI units.")]


@dataclass(frozen=True)
class RobotPortNow:
    port: str
    model: str | None


@dataclass(frozen=True)
class StopMeasured:
    """A stop of a robot that moved, from its cause (the last good frame, the operator's last
    sign, the guard's verdict, the packet of a fault, the request) until it stood."""

    zero_ms: Annotated[float | None, means("Time until the stop command was sent.")]
    stood_ms: Annotated[float | None, means("Time until its encoders reported standstill.")]
    distance_m: Annotated[
        float | None, means("Distance driven from cause to standstill, by odometry.")
    ]
    speed_mps: Annotated[float | None, means("Speed at the cause, by its encoders.")]
    separation_m: Annotated[
        float | None,
        means(
            "Clearance left to what is seen or echoes ahead, after a stop by the guard; "
            "null if the obstacle itself approached."
        ),
    ]


@dataclass(frozen=True)
class RobotIncident:
    """Something stopped a robot or switched its motors off."""

    at: Annotated[str, means("Wall clock, UTC.")]
    role: Annotated[Role | None, means("null: all robots.")]
    kind: str
    sentence: str
    speed_mps: Annotated[float | None, means("Speed at that moment, by its encoders.")]
    stops: Annotated[
        Mapping[Role, StopMeasured],
        means("Measured stop of each robot that was moving, once it has stopped."),
    ]


@dataclass(frozen=True)
class CheckStep:
    name: str
    title: str
    instruction: str
    state: Literal["waiting", "driving", "passed", "failed", "skipped"]
    kind: Annotated[str | None, means("Kind of the stop that was counted.")]
    sentence: str | None
    at: Annotated[str | None, means("Wall clock of its cause, UTC.")]
    operator: Annotated[str | None, means("Who was driving.")]
    figures: StopMeasured | None
    verdict: Annotated[str | None, means("Comparison with the limit.")]
    told: Annotated[str | None, means("The newest stop that was not counted, and why.")]
    skipped_by: str | None


@dataclass(frozen=True)
class CheckFacts:
    """A guided check as it stands."""

    role: Role
    note: str | None
    started_at: str
    started_by: str
    ended_at: str | None
    outcome: CheckOutcome | None
    given_up_by: str | None
    present: Annotated[int | None, means("Current step, from 0; null at the end.")]
    promised_ms: float
    steps: Sequence[CheckStep]


@dataclass(frozen=True)
class CheckNow(CheckFacts):
    """The guided check in progress, or the last one."""

    record: Annotated[str | None, means("Name under which it is saved.")]
    trouble: Annotated[str | None, means("Why it could not be saved.")]


@dataclass(frozen=True)
class ChecksNow:
    check: CheckNow | None
    advice: Annotated[str | None, means("Why to check (again), one sentence.")]


@dataclass(frozen=True)
class CheckEntry:
    name: str
    role: Role
    started_at: str
    outcome: CheckOutcome
    note: str | None
    states: Annotated[Mapping[str, str], means("By step.")]


@dataclass(frozen=True)
class CheckedRobot:
    """Facts that the robot reported; null: not reported."""

    name: str | None = None
    model: str | None = None
    watchdog_s: float | None = None


@dataclass(frozen=True)
class CheckRecord(CheckFacts):
    """A check that has ended, with what the guard depended on, as it is kept."""

    robot: CheckedRobot
    operators: Annotated[Sequence[str], means("Who was driving.")]
    software: Annotated[Mapping[str, str], means("Versions by name.")]
    source: str
    calibration: Annotated[str | None, means("Its id; null: the source's own.")]
    rig: Annotated[str, means("Its id; the same if only the robots' ports differ.")]
    rig_yaml: Annotated[str, means("Without ports, which may contain keys.")]
    guard: Annotated[ParameterValues, means("Its parameters by dotted name.")]
    changed_meanwhile: Annotated[
        Sequence[str], means("What has changed since its beginning, in words.")
    ]


Robots = Mapping[Role, RobotNow | None]


@dataclass(frozen=True)
class DriveFacts:
    """State of the drive process at one instant."""

    stopped: Annotated[Latch | None, means("The stop holds until it is reset.")]
    sight: SightNow | None
    loop: DriveLoopFacts | None
    programme: ProgrammeNow | None
    goal: GoalNow | None
    robots: Robots


@dataclass(frozen=True)
class RobotsNow(DriveFacts):
    """Everything about driving."""

    process: DriveProcess
    world: Annotated[
        str | None, means("World of the open source; null: there is nothing to drive in.")
    ]
    ports: Annotated[Mapping[Role, RobotPortNow | None], means("Ports of real robots.")]
    trouble: Annotated[Mapping[Role, str | None], means("Why a robot could not be connected.")]
    incidents: Annotated[Sequence[RobotIncident], means("The last 20, oldest first.")]
    check: Annotated[CheckNow | None, means("The guided check of the guard, if any.")]


@dataclass(frozen=True)
class WheelSpeed:
    """Speeds of an armed robot at one instant of the source's clock."""

    role: Role
    time: Annotated[float, means("Time on the source's clock, s.")]
    sent_mps: Annotated[float, means("Commanded speed.")]
    encoder_mps: Annotated[float | None, means("Measured speed; null if the robot reports none.")]


@dataclass(frozen=True)
class ProgrammeEntry:
    name: str
    title: str
    help: str
    roles: Sequence[Role]
    duration_s: Annotated[float, means("Duration of one repetition, with its gesture.")]
    own: Annotated[bool, means("Whether it was added by a user; the others are built in.")]


@dataclass(frozen=True)
class ProgrammeDetail(ProgrammeEntry):
    text: Annotated[str, means("YAML.")]
