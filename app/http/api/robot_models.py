"""Robots and programmes as OpenAPI shows them."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, StrictBool, StrictInt

from app.http.api.values import Identifier, In, Name
from observer.motion_profiles.playing import MAX_REPEAT
from observer.motion_profiles.profile_file import MAX_BYTES

RoleName = Literal["observer", "obstacle"]
RobotModelName = Literal["p3dx-sh", "p3dx", "amigo-sh", "amigo"]


class PortChoice(In):
    port: Annotated[str, Field(strict=True, min_length=1, max_length=200)] = Field(
        description="As in /dev/ttyUSB0, a path below /dev/serial/by-id, socket://HOST:8101, "
        "coppeliasim:HOST:PORT/OBJECT, external:HOST:PORT?key=KEY; as it is shown (without its "
        "key): the key stays."
    )
    model: RobotModelName | None = Field(None, description="None: as the robot says of itself.")


class Arming(In):
    lease: Identifier | None = Field(None, description="Of who drives it; None where nobody does.")


class ProgrammeStart(In):
    name: Identifier
    repeat: Annotated[StrictInt, Field(ge=1, le=MAX_REPEAT)] = 1
    reverse: StrictBool = Field(False, description="The same way back.")
    leases: dict[RoleName, Identifier] = Field(
        description="By role, of every robot that it moves; each must be armed."
    )


class ProgrammeText(In):
    text: Annotated[str, Field(strict=True, min_length=1, max_length=MAX_BYTES)]


class By(In):
    """Who asks, as others shall read it; the address is added."""

    name: Name | None = None


class CheckStart(By):
    role: RoleName = "observer"
    note: Annotated[str, Field(strict=True, max_length=500)] | None = None


# --- answers --------------------------------------------------------------------------------


class Latch(BaseModel):
    by: str
    since: float = Field(description="The host's monotonic clock, s.")


class DriveProcess(BaseModel):
    alive: bool
    pid: int | None
    restarts: int
    trouble: str | None = Field(description="Why nothing can be driven, one sentence.")


class Velocity(BaseModel):
    speed_mps: float
    turn_rate_radps: float


class RobotNow(BaseModel):
    """One robot that is connected, or shall be."""

    port: str
    name: str | None
    world: str
    state: Literal["connecting", "disarmed", "armed", "moving", "waiting", "refused"]
    operator: str | None
    present: bool
    why: str | None = Field(description="Why it does not move as asked, or is disarmed.")
    commanded: Velocity = Field(description="As asked for.")
    sent: Velocity = Field(description="As really sent.")
    guard: dict[str, Any] | None = Field(
        description="level (clear, slow, stop), reason, limit_mps, and stop_zone and slow_zone: "
        "corners in the robot's base frame, metres."
    )
    report: dict[str, Any] = Field(description="What the robot says of itself, SI units.")


class RobotPortNow(BaseModel):
    port: str
    model: str | None


class StopMeasured(BaseModel):
    """A stop of a robot that moved, from its cause (the last good frame, the operator's last
    sign, the guard's verdict, the packet of a fault, the request) until it stood."""

    zero_ms: float | None = Field(description="Until zero went out on its port.")
    stood_ms: float | None = Field(description="Until its encoders told that it stands.")
    distance_m: float | None = Field(description="Driven meanwhile, by odometry.")
    speed_mps: float | None = Field(description="At the cause, by its encoders.")
    separation_m: float | None = Field(
        description="Left to what is seen or echoes ahead, behind a stop of the guard; null where "
        "what stopped it came nearer by itself."
    )


class RobotIncident(BaseModel):
    """Something stopped a robot, or took its motors away."""

    at: str = Field(description="Wall clock, UTC.")
    role: str | None = Field(description="None: all robots.")
    kind: str
    sentence: str
    speed_mps: float | None = Field(description="At that moment, by its encoders.")
    stops: dict[RoleName, StopMeasured] = Field(
        description="Of each robot that moved, once it stands."
    )


class CheckStep(BaseModel):
    name: str
    title: str
    instruction: str
    state: Literal["waiting", "driving", "passed", "failed", "skipped"]
    kind: str | None = Field(description="Of the stop that was taken.")
    sentence: str | None
    at: str | None = Field(description="Wall clock of its cause, UTC.")
    operator: str | None = Field(description="Who drove.")
    figures: StopMeasured | None
    verdict: str | None = Field(description="How that compares with what is promised.")
    told: str | None = Field(description="The newest stop that was not taken, and why.")
    skipped_by: str | None


class CheckNow(BaseModel):
    """A guided check that goes on, or the one that ended last."""

    role: RoleName
    note: str | None
    started_at: str
    started_by: str
    ended_at: str | None
    outcome: Literal["passed", "failed", "incomplete", "given_up"] | None
    given_up_by: str | None
    present: int | None = Field(description="Which step it is at, from 0; None at its end.")
    promised_ms: float
    steps: list[CheckStep]
    record: str | None = Field(description="The name under which it is kept.")
    trouble: str | None = Field(description="Why it could not be kept.")


class ChecksNow(BaseModel):
    check: CheckNow | None
    advice: str | None = Field(description="Why to check (again), one sentence.")


class CheckEntry(BaseModel):
    name: str
    role: RoleName
    started_at: str
    outcome: Literal["passed", "failed", "incomplete", "given_up"]
    note: str | None
    states: dict[str, str] = Field(description="By step.")


class RobotsNow(BaseModel):
    """Everything of driving."""

    stopped: Latch | None = Field(description="The stop holds until it is reset.")
    sight: dict[str, Any] | None = Field(description="age_s, status, world of the newest frame.")
    loop: dict[str, Any] | None = Field(description="How punctual the drive loop is.")
    programme: dict[str, Any] | None = Field(description="The one that is driven.")
    robots: dict[RoleName, RobotNow | None]
    process: DriveProcess
    world: str | None = Field(description="Of the open source; None: nothing to drive in.")
    ports: dict[RoleName, RobotPortNow | None] = Field(description="Of real robots.")
    trouble: dict[RoleName, str | None] = Field(description="Why a robot could not be connected.")
    incidents: list[RobotIncident] = Field(description="The last 20, oldest first.")
    check: CheckNow | None = Field(description="The guided check of the guard, if any.")


class ProgrammeEntry(BaseModel):
    name: str
    title: str
    help: str
    roles: list[RoleName]
    duration_s: float = Field(description="Once, with its gesture.")
    own: bool = Field(description="Brought by a person; the others come with the project.")


class ProgrammeDetail(ProgrammeEntry):
    text: str = Field(description="YAML.")
