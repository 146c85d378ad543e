"""Materials of a person's clothes, skin and hair; unspecified ones are drawn from a seed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import get_args

import numpy as np

from observer.simulation.facets import Material
from observer.simulation.people.figure import Cloth
from observer.simulation.specs.people import ClothesSpec, Pattern, Tone

# Blue, green, red: tones that people wear.
_TONES: Mapping[Tone, tuple[int, int, int]] = {
    "black": (28, 26, 26),
    "charcoal": (58, 54, 52),
    "grey": (120, 118, 116),
    "beige": (150, 178, 192),
    "white": (214, 216, 216),
    "navy": (74, 44, 34),
    "blue": (150, 96, 52),
    "green": (62, 92, 60),
    "red": (48, 42, 148),
    "ochre": (52, 128, 184),
}
TONES = tuple(_TONES)
PATTERNS: tuple[Pattern, ...] = get_args(Pattern)
_SKIN = ((148, 178, 214), (110, 150, 196), (80, 112, 160), (50, 70, 104))
_HAIR = ((24, 26, 30), (30, 44, 66), (60, 100, 140), (120, 124, 126))


def dressed(clothes: ClothesSpec, seed: int) -> dict[Cloth, Material]:
    """Return the material of every cloth; equal seeds give equal outfits."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, 0xC107E5]))
    skin, hair = _SKIN[rng.integers(len(_SKIN))], _HAIR[rng.integers(len(_HAIR))]

    def cloth(kind: str, tone: Tone | None, pattern: Pattern | None) -> Material:
        first = tone or TONES[rng.integers(len(TONES))]
        others = [name for name in TONES if name != first]
        second = others[rng.integers(len(others))]
        made = pattern or PATTERNS[rng.integers(len(PATTERNS))]
        number = seed + (0 if kind == "top" else 1)
        return Material(f"cloth_{made}", number, (*_bgr(_TONES[first]), *_bgr(_TONES[second], "2")))

    return {
        "top": cloth("top", clothes.top_tone, clothes.top),
        "trousers": cloth("trousers", clothes.trousers_tone, clothes.trousers),
        "shoes": Material("cloth_plain", seed + 2, _bgr(_TONES["black"])),
        "skin": Material("skin", seed + 3, _bgr(skin)),
        "hair": Material("hair", seed + 4, _bgr(hair)),
    }


def _bgr(colour: tuple[int, int, int], which: str = "") -> tuple[tuple[str, float | str], ...]:
    return tuple(
        (f"{name}{which}", float(value)) for name, value in zip("bgr", colour, strict=True)
    )
