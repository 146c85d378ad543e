"""Robots and programmes as OpenAPI shows them."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, StrictBool, StrictInt

from app.web.api.values import Identifier, In
from observer.programmes.playing import MAX_REPEAT
from observer.programmes.programme_file import MAX_BYTES

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
    lease: Identifier | None = Field(
        None, description="Of who drives it; None where nobody does."
    )


class ProgrammeStart(In):
    name: Identifier
    repeat: Annotated[StrictInt, Field(ge=1, le=MAX_REPEAT)] = 1
    reverse: StrictBool = Field(False, description="The same way back.")
    leases: dict[RoleName, Identifier] = Field(
        description="By role, of every robot that it moves; each must be armed."
    )


class ProgrammeText(In):
    text: Annotated[str, Field(strict=True, min_length=1, max_length=MAX_BYTES)]


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


class IncidentNow(BaseModel):
    at: str = Field(description="Wall clock, UTC.")
    role: str | None = Field(description="None: all robots.")
    kind: str
    sentence: str
    speed_mps: float | None


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
    incidents: list[IncidentNow] = Field(description="The last 20, oldest first.")


class ProgrammeEntry(BaseModel):
    name: str
    title: str
    help: str
    roles: list[RoleName]
    duration_s: float = Field(description="Once, with its gesture.")
    own: bool = Field(description="Brought by a person; the others come with the project.")


class ProgrammeDetail(ProgrammeEntry):
    text: str = Field(description="YAML.")
