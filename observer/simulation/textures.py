"""Textures and their pyramids, painted from a material when first drawn.

A level is chosen so that one texture pixel falls on about one image pixel. Levels are half an
octave apart, which keeps the error within a factor of 1.2: neither aliasing nor blur is visible.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.simulation.facets import Material
from observer.simulation.painting import boards, clothes, posters, surfaces, things
from observer.simulation.painting.canvas import Canvas

# Levels smaller than this are never needed: nothing is that small in the image.
_SMALLEST_PX = 3
_LEVELS_PER_OCTAVE = 2

Painter = Callable[[Canvas], NDArray[np.uint8]]

# By kind of material: its painter and default density, pixels per metre.
_PAINTERS: dict[str, tuple[Painter, float]] = {
    "floor_wood": (surfaces.wood, 230),
    "floor_tiles": (surfaces.tiles, 230),
    "wall_painted": (surfaces.painted_wall, 180),
    "wall_panels": (surfaces.panelled_wall, 180),
    "wall_bare": (surfaces.bare_wall, 180),
    "ceiling": (surfaces.ceiling, 30),
    "shadow": (surfaces.shadow, 120),
    "crate_side": (things.crate_side, 420),
    "crate_top": (things.crate_top, 420),
    "cardboard_side": (things.cardboard_side, 420),
    "cardboard_top": (things.cardboard_top, 420),
    "cabinet_side": (things.cabinet_side, 420),
    "cabinet_top": (things.cabinet_top, 420),
    "flat": (things.flat, 40),
    "door": (things.door, 320),
    "p3dx_side": (things.robot_side, 600),
    "p3dx_deck": (things.robot_deck, 500),
    "dark_robot_side": (things.dark_robot, 600),
    "dark_robot_deck": (things.dark_robot, 500),
    "dark_robot_payload": (things.dark_robot, 600),
    "dark_robot_lid": (things.dark_robot, 500),
    "scanner_payload": (things.scanner_payload, 600),
    "scanner_lid": (things.scanner_lid, 400),
    "wheel_disc": (things.wheel_disc, 600),
    "wheel_dark": (things.wheel_disc, 600),
    "rubber": (things.rubber, 600),
    "poster_rings": (posters.framed(posters.rings), 320),
    "poster_blocks": (posters.framed(posters.blocks), 320),
    "poster_map": (posters.framed(posters.city_map), 320),
    "poster_waves": (posters.framed(posters.waves), 320),
    "poster_tag": (posters.framed(posters.tag), 320),
    "poster_sign": (posters.framed(posters.sign), 320),
    "board_chessboard": (boards.chessboard, 2500),
    "board_charuco": (boards.charuco, 2500),
    "poster_checkerboard": (posters.checkerboard, 320),
    "cloth_plain": (clothes.plain, 400),
    "cloth_folded": (clothes.folded, 400),
    "cloth_denim": (clothes.denim, 400),
    "cloth_striped": (clothes.striped, 400),
    "cloth_checked": (clothes.checked, 400),
    "cloth_printed": (clothes.printed, 400),
    "skin": (clothes.skin, 400),
    "hair": (clothes.hair, 400),
}


@dataclass(frozen=True, eq=False)
class Level:
    """One level of a pyramid.

    Attributes:
        image: (h, w, 3) uint8.
        sx, sy: pixels per metre of this level along its columns and rows, so that the point
            (s, t) metres lies at pixel (s * sx - 0.5, t * sy - 0.5).
    """

    image: NDArray[np.uint8]
    sx: float
    sy: float


@dataclass(frozen=True, eq=False)
class Texture:
    """A painted surface at all its levels, each made from the finest one at first use.

    Attributes:
        finest: the level as painted.
        extent: metres (along, down).
        density: pixels per metre of the finest level.
        samples: least number of samples along each axis of an image pixel; more than one if
            edges are to be measured.
    """

    finest: Level
    extent: tuple[float, float]
    density: float
    samples: int = 1
    # Cache by level. It needs no lock: threads that make a level at once make equal ones.
    _made: dict[int, Level] = field(default_factory=dict, repr=False)

    def level(self, density: float) -> Level:
        """Return the level whose density comes closest to ``density``, pixels per metre."""
        k = self._coarsest
        if density > 0:
            k = min(k, max(0, round(_LEVELS_PER_OCTAVE * math.log2(self.density / density))))
        if k == 0:
            return self.finest
        found = self._made.get(k)
        if found is None:
            found = self._made[k] = self._shrunk(k)
        return found

    @cached_property
    def _coarsest(self) -> int:
        """Index of the last level of at least ``_SMALLEST_PX``."""
        k = 0
        while max(self._size(k + 1)) >= _SMALLEST_PX:
            k += 1
        return k

    def _size(self, k: int) -> tuple[int, int]:
        """Return the pixels (along, down) of a level."""
        height, width = self.finest.image.shape[:2]
        shrink = 2 ** (-k / _LEVELS_PER_OCTAVE)
        return round(width * shrink), round(height * shrink)

    def _shrunk(self, k: int) -> Level:
        w, h = (max(side, 1) for side in self._size(k))
        image = cv2.resize(self.finest.image, (w, h), interpolation=cv2.INTER_AREA)
        return Level(np.asarray(image, np.uint8), w / self.extent[0], h / self.extent[1])


def paint(material: Material, extent: tuple[float, float]) -> Texture:
    """Paint a material over ``extent`` metres (along, down)."""
    painter, density = _PAINTERS[material.kind]
    density = material.number("density", density)
    width = max(4, round(extent[0] * density))
    height = max(4, round(extent[1] * density))
    rng = np.random.default_rng(
        np.random.SeedSequence([material.seed, zlib.crc32(material.kind.encode())])
    )
    image = painter(Canvas(width, height, density, rng, material))
    finest = Level(image, width / extent[0], height / extent[1])
    return Texture(finest, extent, density, round(material.number("samples", 1)))
