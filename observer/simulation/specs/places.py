"""The room and its objects."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from observer.simulation.specs.base import Degrees, Finite, Fraction, Positive, Spec


class RoomSpec(Spec):
    """A rectangular room; ``walls`` and ``floor`` name their textures."""

    x: tuple[Finite, Finite] = (-2.5, 6.0)
    y: tuple[Finite, Finite] = (-3.5, 3.5)
    height_m: float = Field(2.8, ge=1, le=20)
    floor: Literal["wood", "tiles"] = "wood"
    walls: Literal["painted", "panels"] = "painted"

    @model_validator(mode="after")
    def _is_a_room(self) -> RoomSpec:
        for name, (low, high) in (("x", self.x), ("y", self.y)):
            if not 1 <= high - low <= 60:
                raise ValueError(f"room.{name} must span 1 to 60 m, lower end first")
        return self


class BoxSpec(Spec):
    """A crate or a cardboard box on the floor, or on another one (``above_m``)."""

    kind: Literal["crate", "cardboard", "cabinet"]
    x: Finite
    y: Finite
    heading_deg: Degrees = 0.0
    size: tuple[Positive, Positive, Positive] = (0.5, 0.5, 0.5)
    above_m: float = Field(0.0, ge=0, le=10)


class PosterSpec(Spec):
    """A picture on a wall.

    ``wall`` is named as seen from the start; ``along_m`` is y on the front and back wall and x
    on the left and right one; ``height_m`` is the height of the picture's centre.
    """

    kind: Literal["poster"]
    wall: Literal["front", "back", "left", "right"]
    along_m: Finite
    height_m: float = Field(0.9, gt=0, le=20)
    size: tuple[Positive, Positive] = (0.6, 0.8)
    design: Literal["rings", "blocks", "map", "waves", "tag", "sign", "checkerboard"] = "rings"


ObjectSpec = Annotated[BoxSpec | PosterSpec, Field(discriminator="kind")]


class TextureSpec(Spec):
    """Visibility of all textures.

    Attributes:
        contrast: of every texture; 1 as painted, 0 uniform colours.
        share_without: share of the walls and the floor that is left without texture.
        robot: ``red`` as a P3-DX looks, or ``dark``: dark and weakly textured.
    """

    contrast: float = Field(1.0, ge=0, le=2)
    share_without: Fraction = 0.0
    robot: Literal["red", "dark"] = "red"
