"""Poses of the cameras on their robot, as reported to clients."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

from pydantic import ConfigDict, Field

from app.contract.status import MountStatus
from app.contract.values import means


@dataclass(frozen=True)
class RigNumber:
    # Clients send it as well, so it is validated.
    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid")

    value: Annotated[float, Field(strict=True, allow_inf_nan=False)]
    sigma: Annotated[
        Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)] | None,
        means("Standard deviation of an estimate; null: the value was entered."),
    ] = None


@dataclass(frozen=True)
class RigNow:
    mount: Mapping[str, RigNumber]
    models: Mapping[str, str]
    bodies: Annotated[
        Sequence[str], means("Motion-capture bodies whose pose on the robot is known.")
    ]
    for_simulated: bool
    calibration: str | None
    file: str | None
    in_use: Annotated[MountStatus | None, means("The mount in use for the open source.")]


@dataclass(frozen=True)
class FloorEstimate:
    height_m: RigNumber
    tilt_deg: RigNumber
    roll_deg: RigNumber
    share: Annotated[float, means("Share of the points that lie on the floor.")]
    views: int
    sentence: str


@dataclass(frozen=True)
class DriveNow:
    noting: bool
    values: Annotated[
        Mapping[str, RigNumber], means("Estimated values by the rig's keys, as far as determined.")
    ]
    still_needed: Annotated[
        Sequence[str], means("What to drive so that the rest can be estimated.")
    ]
    sentence: str
