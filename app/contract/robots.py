"""Robots, their guided check and programmes, as they are told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from app.contract.values import means
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

    level: Literal["clear", "slow", "stop"]
    reason: str | None
    limit_mps: Annotated[float | None, means("The highest speed along the present arc.")]
    stop_zone: Sequence[tuple[float, float]]
    slow_zone: Sequence[tuple[float, float]]


@dataclass(frozen=True)
class SightNow:
    """The newest frame that the drive process was told of."""

    age_s: float | None
    status: str | None
    world: str | None


@dataclass(frozen=True)
class DriveLoop:
    """Punctuality of the drive loop."""

    ticks: int
    late_p99_ms: float | None
    late_max_ms: float | None
    priority: str


@dataclass(frozen=True)
class ProgrammeNow:
    """The programme that is driven."""

    name: str
    phase: Literal["gesture", "driving"]
    round: Annotated[int, means("Of repeat, from 1.")]
    elapsed_s: float
    duration_s: float
    repeat: int
    reverse: bool


@dataclass(frozen=True)
class GoalNow:
    """Goal to which the observer drives, or drove last. Places are metres ahead of the robot and
    to its left, as it stands now."""

    state: Literal["driving", "reached", "ended"]
    sentence: Annotated[str, means("What the robot does and why, or why it ended.")]
    place: Annotated[tuple[float, float] | None, means("None: not known any more.")]
    distance_m: float | None
    elapsed_s: float
    path: Annotated[Sequence[tuple[float, float]], means("Planned for the next seconds.")]
    risk_per_metre: Annotated[
        float, means("Declared, of a contact with tracked obstacles on each metre.")
    ]
    planned_risk_per_metre: Annotated[float | None, means("Of the path, until it could stand.")]
    waits_for: Annotated[
        int | None, means("Track for which it stands or turns aside; below zero: not numbered yet.")
    ]
    meets_s: Annotated[float | None, means("Until it would meet that track, s.")]
    meets_at: Annotated[
        tuple[float, float] | None, means("Where that track is predicted to be then.")
    ] = None
    refused: Annotated[
        Sequence[RefusedPath], means("Some paths that it does not take, the best one first.")
    ] = ()


@dataclass(frozen=True)
class RobotNow:
    """One robot that is connected, or shall be."""

    port: str
    name: str | None
    world: str
    state: Literal["connecting", "disarmed", "armed", "moving", "waiting", "refused"]
    operator: str | None
    present: bool
    why: Annotated[str | None, means("Why it does not move as asked, or is disarmed.")]
    commanded: Annotated[Velocity, means("As asked for.")]
    sent: Annotated[Velocity, means("As really sent.")]
    guard: GuardVerdict | None
    report: Annotated[RobotReport, means("What the robot says of itself, SI units.")]


@dataclass(frozen=True)
class RobotPortNow:
    port: str
    model: str | None


@dataclass(frozen=True)
class StopMeasured:
    """A stop of a robot that moved, from its cause (the last good frame, the operator's last
    sign, the guard's verdict, the packet of a fault, the request) until it stood."""

    zero_ms: Annotated[float | None, means("Until zero went out on its port.")]
    stood_ms: Annotated[float | None, means("Until its encoders told that it stands.")]
    distance_m: Annotated[float | None, means("Driven meanwhile, by odometry.")]
    speed_mps: Annotated[float | None, means("At the cause, by its encoders.")]
    separation_m: Annotated[
        float | None,
        means(
            "Left to what is seen or echoes ahead, behind a stop of the guard; null where "
            "what stopped it came nearer by itself."
        ),
    ]


@dataclass(frozen=True)
class RobotIncident:
    """Something stopped a robot, or took its motors away."""

    at: Annotated[str, means("Wall clock, UTC.")]
    role: Annotated[Role | None, means("None: all robots.")]
    kind: str
    sentence: str
    speed_mps: Annotated[float | None, means("At that moment, by its encoders.")]
    stops: Annotated[
        Mapping[Role, StopMeasured], means("Of each robot that moved, once it stands.")
    ]


@dataclass(frozen=True)
class CheckStep:
    name: str
    title: str
    instruction: str
    state: Literal["waiting", "driving", "passed", "failed", "skipped"]
    kind: Annotated[str | None, means("Of the stop that was taken.")]
    sentence: str | None
    at: Annotated[str | None, means("Wall clock of its cause, UTC.")]
    operator: Annotated[str | None, means("Who drove.")]
    figures: StopMeasured | None
    verdict: Annotated[str | None, means("How that compares with what is promised.")]
    told: Annotated[str | None, means("The newest stop that was not taken, and why.")]
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
    present: Annotated[int | None, means("Which step it is at, from 0; None at its end.")]
    promised_ms: float
    steps: Sequence[CheckStep]


@dataclass(frozen=True)
class CheckNow(CheckFacts):
    """A guided check that goes on, or the one that ended last."""

    record: Annotated[str | None, means("The name under which it is kept.")]
    trouble: Annotated[str | None, means("Why it could not be kept.")]


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
    """Facts that a robot told of itself; None: not told."""

    name: str | None = None
    model: str | None = None
    watchdog_s: float | None = None


@dataclass(frozen=True)
class CheckRecord(CheckFacts):
    """A check that has ended, with what the guard depended on, as it is kept."""

    robot: CheckedRobot
    operators: Annotated[Sequence[str], means("Who drove.")]
    software: Annotated[Mapping[str, str], means("Versions by name.")]
    source: str
    calibration: Annotated[str | None, means("Its id; None: the source's own.")]
    rig: Annotated[str, means("Its id, the same where only the robots' ports differ.")]
    rig_yaml: Annotated[str, means("Without ports, which may contain keys.")]
    guard: Annotated[Mapping[str, Any], means("Its parameters by dotted name.")]
    changed_meanwhile: Annotated[Sequence[str], means("Since its beginning, in words.")]


Robots = Mapping[Role, RobotNow | None]


@dataclass(frozen=True)
class DriveFacts:
    """State of the drive process at one instant."""

    stopped: Annotated[Latch | None, means("The stop holds until it is reset.")]
    sight: SightNow | None
    loop: DriveLoop | None
    programme: ProgrammeNow | None
    goal: GoalNow | None
    robots: Robots


@dataclass(frozen=True)
class RobotsNow(DriveFacts):
    """Everything of driving."""

    process: DriveProcess
    world: Annotated[str | None, means("Of the open source; None: nothing to drive in.")]
    ports: Annotated[Mapping[Role, RobotPortNow | None], means("Of real robots.")]
    trouble: Annotated[Mapping[Role, str | None], means("Why a robot could not be connected.")]
    incidents: Annotated[Sequence[RobotIncident], means("The last 20, oldest first.")]
    check: Annotated[CheckNow | None, means("The guided check of the guard, if any.")]


@dataclass(frozen=True)
class WheelSpeed:
    """Speeds of an armed robot at one instant of the source's clock."""

    role: Role
    time: Annotated[float, means("Of the source, s.")]
    sent_mps: Annotated[float, means("As it was commanded.")]
    encoder_mps: Annotated[float | None, means("None where the robot tells none.")]


@dataclass(frozen=True)
class ProgrammeEntry:
    name: str
    title: str
    help: str
    roles: Sequence[Role]
    duration_s: Annotated[float, means("Once, with its gesture.")]
    own: Annotated[bool, means("Brought by a person; the others come with the project.")]


@dataclass(frozen=True)
class ProgrammeDetail(ProgrammeEntry):
    text: Annotated[str, means("YAML.")]
