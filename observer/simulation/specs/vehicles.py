"""Vehicles and their motions over the floor."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from observer.simulation.specs.base import Degrees, Finite, Positive, SineSpec, Spec

# P3-DX: 455 x 381 x 237 mm (MobileRobots data sheet), AmigoBot: 330 x 280 x 150 mm.
P3DX_SIZE = (0.455, 0.381, 0.237)
AMIGOBOT_SIZE = (0.33, 0.28, 0.15)


class DriveLeg(Spec):
    """A straight leg, backwards with a negative distance."""

    kind: Literal["drive"]
    distance_m: Finite
    speed: float = Field(gt=0, le=20)


class ArcLeg(Spec):
    """A leg along a circle; a positive angle is to the left."""

    kind: Literal["arc"]
    radius_m: Positive
    angle_deg: Degrees
    speed: float = Field(gt=0, le=20)


class TurnLeg(Spec):
    """A turn on the spot; a positive angle is to the left."""

    kind: Literal["turn"]
    angle_deg: Degrees
    rate_deg: float = Field(gt=0, le=720)


class WaitLeg(Spec):
    """A wait."""

    kind: Literal["wait"]
    seconds: Positive


LegSpec = Annotated[DriveLeg | ArcLeg | TurnLeg | WaitLeg, Field(discriminator="kind")]


class _DrivenSpec(Spec):
    after: Literal["stay", "repeat", "back"] = "stay"
    acceleration: float = Field(0.5, gt=0, le=50)
    angular_acceleration_deg: float = Field(100.0, gt=0, le=10000)


class CourseSpec(_DrivenSpec):
    """Legs driven one after the other."""

    kind: Literal["course"]
    legs: tuple[LegSpec, ...] = Field(min_length=1)


class WaypointsSpec(_DrivenSpec):
    """A drive from point to point at one speed, turning on the spot towards the next one."""

    kind: Literal["waypoints"]
    points: tuple[tuple[Finite, Finite], ...] = Field(min_length=1)
    speed: float = Field(gt=0, le=20)
    turn_rate_deg: float = Field(45.0, gt=0, le=720)


class SwaySpec(Spec):
    """Sines about the start pose; ``turn`` in degrees, the others in metres."""

    kind: Literal["sway"]
    forward: SineSpec = SineSpec()
    left: SineSpec = SineSpec()
    turn: SineSpec = SineSpec()


MotionSpec = Annotated[CourseSpec | WaypointsSpec | SwaySpec, Field(discriminator="kind")]


class VehicleSpec(Spec):
    """Start and motion of a vehicle; without a motion it is parked."""

    x: Finite = 0.0
    y: Finite = 0.0
    heading_deg: Degrees = 0.0
    motion: MotionSpec | None = None


class RobotSpec(VehicleSpec):
    """A P3-DX; if taller than 0.237 m it carries a payload up to its height."""

    name: str = Field("P3-DX", min_length=1, max_length=40)
    size: tuple[Positive, Positive, Positive] = P3DX_SIZE
