"""The rig as OpenAPI shows it."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, StrictBool

from app.contract.rig import RigNumber
from app.http.api.values import In
from observer.rig.rig import MOUNT_KEYS

RobotModel = Literal["p3dx-sh", "p3dx", "amigo-sh", "amigo"]


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
