"""Robots and programmes as OpenAPI shows them."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, StrictBool, StrictInt

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
