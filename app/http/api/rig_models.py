"""The rig as OpenAPI shows it."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, Field, StrictBool

from app.http.api.models import MountStatus
from app.http.api.values import Finite, In
from observer.rig.rig import MOUNT_KEYS

RobotModel = Literal["p3dx-sh", "p3dx", "amigo-sh", "amigo"]


class RigNumber(In):
    value: Finite
    sigma: Annotated[Finite, Field(gt=0)] | None = Field(
        None, description="One standard deviation of an estimate; None: it was typed."
    )


class RigMount(In):
    """Of the left camera; metres and degrees. None: it is not known."""

    height_m: RigNumber | None = None
    tilt_deg: RigNumber | None = Field(None, description="By which it looks down.")
    roll_deg: RigNumber | None = Field(None, description="Right side down.")
    pan_deg: RigNumber | None = Field(None, description="To the left of where the robot drives.")
    forward_m: RigNumber | None = Field(None, description="From the middle of the axle.")
    left_m: RigNumber | None = None

    def pairs(self) -> dict[str, tuple[float, float | None] | None]:
        """Value and standard deviation by key."""
        numbers = ((key, getattr(self, key)) for key in MOUNT_KEYS)
        return {key: None if n is None else (n.value, n.sigma) for key, n in numbers}


class RigChange(In):
    mount: RigMount
    models: dict[Literal["observer", "obstacle"], RobotModel | None] | None = Field(
        None, description="Of the robots by role; None: as they are."
    )
    for_simulated: StrictBool = Field(
        False, description="Simulated sources, which know their mount, take this one instead."
    )


class RigFile(In):
    text: Annotated[str, Field(strict=True, max_length=100_000)]


class RigNow(BaseModel):
    mount: dict[str, RigNumber]
    models: dict[str, str]
    bodies: list[str] = Field(description="Of a mocap system, whose place on the robot is known.")
    for_simulated: bool
    calibration: str | None
    file: str | None
    in_use: MountStatus | None = Field(description="What the open source is observed with.")


class FloorEstimate(BaseModel):
    height_m: RigNumber
    tilt_deg: RigNumber
    roll_deg: RigNumber
    share: float = Field(description="Of all points, those on the floor.")
    views: int
    sentence: str


class DriveNow(BaseModel):
    noting: bool
    values: dict[str, RigNumber] = Field(description="By the rig's keys, as far as told.")
    still_needed: list[str] = Field(description="What to drive so that the rest can be told.")
    sentence: str
