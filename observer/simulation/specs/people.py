"""People: their build, clothes, gestures and paths."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from observer.simulation.specs.base import Spec
from observer.simulation.specs.vehicles import VehicleSpec

Pattern = Literal["plain", "folded", "denim", "striped", "checked", "printed"]
Tone = Literal[
    "black", "charcoal", "grey", "beige", "white", "navy", "blue", "green", "red", "ochre"
]


class ClothesSpec(Spec):
    """Patterns and tones; what is left out is drawn from the scenario's seed."""

    top: Pattern | None = None
    top_tone: Tone | None = None
    trousers: Pattern | None = None
    trousers_tone: Tone | None = None


class PersonSpec(VehicleSpec):
    """A person who walks along a motion, or stands without one.

    Attributes:
        build: girth relative to the average. swing: of the arms, 1 is normal.
        gesture: ``walk``, ``wave`` with the right hand, or ``carry`` a box before the belly.
    """

    name: str = Field("person", min_length=1, max_length=40)
    height_m: float = Field(1.72, ge=0.8, le=2.2)
    build: float = Field(1.0, ge=0.7, le=1.6)
    swing: float = Field(1.0, ge=0, le=2)
    gesture: Literal["walk", "wave", "carry"] = "walk"
    clothes: ClothesSpec = ClothesSpec()
