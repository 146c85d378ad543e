"""Messages between the web process and the drive process; see ``app.runtime.pipe``.

Sight reaches the drive process from the engine directly, as a latest value in shared memory
(``SIGHT_NAME``), and so does the plan of the path to a goal (``PLAN_NAME``). Wheel odometry goes
back the same way (``WHEELS_NAME``).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, Literal

from app.contract.commands import Answer
from app.contract.parameters import ParameterValues
from app.contract.robots import DriveFacts, GoalNow, RobotNow
from observer.motion_profiles.profile import MotionProfile
from observer.rig.rig import Role

# Slots of latest values, beside the engine's views.
#   sight   engine to drive: ``observer.guard.sight.Sight.facts`` as the header, no payload
#   wheels  drive to engine: ``{role: [[time, x, y, yaw], ...]}``, oldest first, the last second
#           of each robot's odometry on the host's monotonic clock; and as ``errand``, while the
#           observer drives to a goal, ``observer.navigation.errand.Errand.facts``; no payload
#   plan    engine to drive: ``observer.navigation.plan.Plan.facts`` as the header, no payload
SIGHT_NAME = "sight"
WHEELS_NAME = "wheels"
PLAN_NAME = "plan"
SHARED_NAMES = (SIGHT_NAME, WHEELS_NAME, PLAN_NAME)

# Seconds for which a command or a sign of presence is valid after it was issued.
COMMAND_FRESH_S = 0.25
# Seconds: maximum age of the newest frame that a plan is based on, since its reception.
PLAN_FRESH_S = 0.3
# Metres: a goal farther away than this is in another room.
FARTHEST_GOAL_M = 20.0

# What stops a robot, or switches its motors off.
IncidentKind = Literal["stop", "expired", "sight", "guard", "fault", "lease", "programme", "goal"]


# --- commands, web to drive ------------------------------------------------------------------


class ToDrive(Generic[Answer]):
    """Command to the drive process; ``Answer`` is the type of its reply's value."""


@dataclass(frozen=True)
class ReallySent:
    """Velocity actually sent for a requested one, and the age of the request."""

    speed_mps: float
    turn_rate_radps: float
    limited_by: str | None
    age_s: float


@dataclass(frozen=True)
class ConnectRobot(ToDrive[None]):
    """Connect the robot of a role; one that was connected before is released first.

    Attributes:
        port: as ``observer.robot_opening.open_robot`` takes it.
        model: of ``observer.robots.models``; None: as the robot reports.
        world: in which it drives, as ``Sight.world``.
        name: shown to people.
    """

    role: Role
    port: str
    model: str | None
    world: str
    name: str | None = None


@dataclass(frozen=True)
class DisconnectRobot(ToDrive[None]):
    """Stop the robot, close its connection and forget its port."""

    role: Role


@dataclass(frozen=True)
class TakeLease(ToDrive[str]):
    """Become the operator of a role. The answer is the lease's id.

    Refused (``state``) while somebody else holds it, unless ``takeover``; after a takeover the
    robot is at zero and disarmed.
    """

    role: Role
    operator: str
    takeover: bool = False


@dataclass(frozen=True)
class ReleaseLease(ToDrive[None]):
    """Release the lease; the robot stops and is disarmed.

    ``lost``: the operator did not ask for it, but the connection to them has ended.
    """

    role: Role
    lease: str
    lost: bool = False


@dataclass(frozen=True)
class ArmRobot(ToDrive[RobotNow | None]):
    """Switch the motors on, at zero. Refused (``state``) with one sentence on what is missing.

    ``lease``: of the operator who arms; may be None if nobody holds the role.
    """

    role: Role
    lease: str | None


@dataclass(frozen=True)
class DisarmRobot(ToDrive[RobotNow | None]):
    """Zero and motors off; anyone may."""

    role: Role


@dataclass(frozen=True)
class StopRobots(ToDrive[None]):
    """Stop all robots; it latches until ``ResetStop``. ``by``: who, in words. Anyone may."""

    by: str


@dataclass(frozen=True)
class ResetStop(ToDrive[None]):
    """Reset the latch and clear the robots' faults; all stay disarmed."""

    by: str


@dataclass(frozen=True)
class DriveCommand(ToDrive[ReallySent]):
    """Velocity while the operator holds a key; also a sign of presence.

    One that is older than ``COMMAND_FRESH_S``, has an old sequence number or a lease that is not
    valid is refused (``state``) and changes nothing.

    Attributes:
        sequence: rises with every command and presence of a lease.
        issued: when it was given, host's monotonic clock.
        speed_mps: forward. turn_rate_radps: positive to the left.
    """

    role: Role
    lease: str
    sequence: int
    issued: float
    speed_mps: float
    turn_rate_radps: float


@dataclass(frozen=True)
class Presence(ToDrive[None]):
    """The operator is there and consents, without a velocity."""

    role: Role
    lease: str
    sequence: int
    issued: float


@dataclass(frozen=True)
class StartProgramme(ToDrive[float]):
    """Drive timed velocities, as long as the operator of every role in it stays present. The answer
    is its duration, seconds.

    ``leases``: by role, for every role that the programme moves; each must be armed.
    """

    programme: MotionProfile
    leases: dict[str, str]
    repeat: int = 1
    reverse: bool = False


@dataclass(frozen=True)
class StopProgramme(ToDrive[None]):
    """End it at zero; the robots stay armed."""


@dataclass(frozen=True)
class StartGoal(ToDrive[GoalNow]):
    """Send the observer to a place, as long as its operator stays present; replaces the previous
    goal. The robot must be armed. The answer is the goal.

    Attributes:
        ahead_m, left_m: from the robot as it stands now.
        risk_per_metre: declared probability of touching somebody on each metre driven.
    """

    lease: str
    ahead_m: float
    left_m: float
    risk_per_metre: float


@dataclass(frozen=True)
class StopGoal(ToDrive[None]):
    """Cancel the goal, at zero; the robot stays armed."""


@dataclass(frozen=True)
class SetGuard(ToDrive[None]):
    """Use these ``guard.*`` parameters from the next tick on, by dotted name."""

    parameters: ParameterValues


@dataclass(frozen=True)
class LeaveDrive(ToDrive[None]):
    """Stop all robots, release them and exit."""


# --- events, drive to web --------------------------------------------------------------------


@dataclass(frozen=True)
class DriveState:
    """State of everything; ten times a second, and at once when anything but a figure changes."""

    facts: DriveFacts
    monotonic: float


@dataclass(frozen=True)
class WheelSpeedEvent:
    """Commanded and measured speed of one robot; ten times a second while it is armed.

    Attributes:
        time: host's monotonic clock of the measurement.
        sent_mps: as sent. encoder_mps: None if the robot reports none.
    """

    role: Role
    time: float
    sent_mps: float
    encoder_mps: float | None


@dataclass(frozen=True)
class IncidentEvent:
    """Something stopped a robot or switched its motors off.

    Attributes:
        sentence: for people. time: host's monotonic clock.
        speed_mps: at that moment, by its encoders.
    """

    role: Role | None
    kind: IncidentKind
    sentence: str
    time: float
    speed_mps: float | None


@dataclass(frozen=True)
class StoppedEvent:
    """A moving robot was stopped by an incident, and now stands or is no longer monitored.

    All times are of the host's monotonic clock.

    Attributes:
        kind, sentence, incident_time: of its ``IncidentEvent``.
        cause_time: the last moment at which all was well: for ``sight`` the reception of the last
            good frame, for ``expired`` and ``lease`` the issue time of the operator's last sign,
            for ``fault`` the packet that reported it (or the last one received), else the incident.
        zero_time: when zero was sent on its port; None if it never was.
        stood_time: of the first status packet by whose encoders it stands (below 0.01 m/s); None
            if it drove on or was not seen to stand within 4 s.
        speed_mps: at the cause, by its encoders. before_mps: the same when the guard began to
            slow it, for ``guard``; otherwise as ``speed_mps``.
        distance_m: by odometry from cause to standing; None without odometry, or with a gap in it.
        separation_m: after a stop by the guard, the clearance to the nearest object seen or
            echoing ahead; None if unknown, or if the obstacle itself approached.
    """

    role: Role
    kind: IncidentKind
    sentence: str
    incident_time: float
    cause_time: float
    zero_time: float | None
    stood_time: float | None
    speed_mps: float | None
    before_mps: float | None
    distance_m: float | None
    separation_m: float | None


FromDriveProcess = DriveState | WheelSpeedEvent | IncidentEvent | StoppedEvent


# --- made by the supervisor ------------------------------------------------------------------


@dataclass(frozen=True)
class DriveStartedEvent:
    """A new drive process is ready, with no robot connected. ``generation`` counts from 1."""

    generation: int
    pid: int


@dataclass(frozen=True)
class DriveLostEvent:
    """The drive process ended or hung, and why in one sentence; robots' firmware stops them."""

    generation: int
    reason: str


FromDrive = FromDriveProcess | DriveStartedEvent | DriveLostEvent
