"""The room and its objects."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from observer.simulation.specs.base import Degrees, Finite, Fraction, Positive, Spec


class RoomSpec(Spec):
    """A rectangular room; ``walls`` and ``floor`` name their textures.

    ``gloss`` is the floor's: 0 is matt, 1 reflects what stands on it like polished stone.
    """

    x: tuple[Finite, Finite] = (-2.5, 6.0)
    y: tuple[Finite, Finite] = (-3.5, 3.5)
    height_m: float = Field(2.8, ge=1, le=20)
    floor: Literal["wood", "tiles"] = "wood"
    walls: Literal["painted", "panels", "bare"] = "painted"
    gloss: Fraction = 0.0

    @model_validator(mode="after")
    def _is_a_room(self) -> RoomSpec:
        for name, (low, high) in (("x", self.x), ("y", self.y)):
            if not 1 <= high - low <= 60:
                raise ValueError(f"room.{name} must span 1 to 60 m, lower limit first")
        return self


class StandingSpec(Spec):
    """An object on the floor, or on another object (``above_m``)."""

    x: Finite
    y: Finite
    heading_deg: Degrees = 0.0
    size: tuple[Positive, Positive, Positive] = (0.5, 0.5, 0.5)
    above_m: float = Field(0.0, ge=0, le=10)


class BoxSpec(StandingSpec):
    """A crate, a cardboard box or a cabinet."""

    kind: Literal["crate", "cardboard", "cabinet"]


class TableSpec(StandingSpec):
    """A bare table: a slab on four legs, each in a flat tone drawn from the seed."""

    kind: Literal["table"]
    size: tuple[Positive, Positive, Positive] = (0.7, 1.4, 0.74)


class HangingSpec(Spec):
    """An object on a wall.

    ``wall`` is named as seen from the start; ``along_m`` is y on the front and back wall and x
    on the left and right one; ``height_m`` is the height of the object's centre.
    """

    wall: Literal["front", "back", "left", "right"]
    along_m: Finite
    height_m: float = Field(0.9, gt=0, le=20)
    size: tuple[Positive, Positive] = (0.6, 0.8)


class DoorSpec(HangingSpec):
    """A closed door: a flat leaf in a frame of another tone, both drawn from the seed."""

    kind: Literal["door"]
    height_m: float = Field(1.03, gt=0, le=20)
    size: tuple[Positive, Positive] = (1.0, 2.06)


class PosterSpec(HangingSpec):
    """A poster."""

    kind: Literal["poster"]
    design: Literal["rings", "blocks", "map", "waves", "tag", "sign", "checkerboard"] = "rings"


ObjectSpec = Annotated[BoxSpec | TableSpec | DoorSpec | PosterSpec, Field(discriminator="kind")]


class TextureSpec(Spec):
    """Strength of all textures.

    Attributes:
        contrast: of every texture; 1 as painted, 0 uniform colours.
        share_without: share of the walls and the floor without texture.
        robot: ``red`` like a real P3-DX, or ``dark``: dark and weakly textured.
    """

    contrast: float = Field(1.0, ge=0, le=2)
    share_without: Fraction = 0.0
    robot: Literal["red", "dark"] = "red"
