"""Local map as a picture on the floor; independent of viser."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from app.contract.events import LocalMapEvent
from app.contract.scene import LAYERS
from observer.geometry import Pose
from observer.occupancy import STATES, OccupancyMap

# Pixels along each side of a cell: enough to see its border from near.
_CELL_PX: Final = 4
# Just above the floor, and below all lines on it.
_HEIGHT_M: Final = 0.006
# Opacity of a cell, of 255: a blocked one hides nearly all of the floor, a free one little.
_FREE_ALPHA: Final = 76
_BLOCKED_ALPHA: Final = 215
_BORDER_ALPHA: Final = 120

Rgba = NDArray[np.uint8]


@dataclass(frozen=True)
class MapTiles:
    """PNG of a map, its side in metres, and the pose of its middle; its rows lie along y."""

    png: bytes
    side_m: float
    T_world_middle: Pose


def map_tiles(event: LocalMapEvent | None) -> MapTiles | None:
    """Return what is drawn of a map; None without one."""
    if event is None or event.map is None or event.T_world_corner is None:
        return None
    local = event.map
    side = local.size * local.cell_m
    middle = Pose.from_rotvec([0.0, 0.0, 0.0], [side / 2, side / 2, _HEIGHT_M])
    done, png = cv2.imencode(".png", cv2.cvtColor(picture_of(local), cv2.COLOR_RGBA2BGRA))
    assert done
    return MapTiles(png.tobytes(), side, event.T_world_corner @ middle)


def picture_of(local: OccupancyMap) -> Rgba:
    """Return the map as a (P, P, 4) picture, rows along y, columns along x; unknown is clear."""
    blocked, free = LAYERS["map"].colors
    inside, border = np.zeros((2, STATES, 4), np.uint8)
    # Transparent pixels lend their colour to their neighbours when the picture is interpolated.
    inside[:, :3] = [free, free, blocked]
    inside[:, 3] = [0, _FREE_ALPHA, _BLOCKED_ALPHA]
    border[:] = inside
    border[-1, 3] = _BORDER_ALPHA
    # By y and x.
    cells = local.cells().T
    tiles = np.repeat(np.repeat(inside[cells], _CELL_PX, axis=0), _CELL_PX, axis=1)
    lines = np.repeat(border[cells], _CELL_PX, axis=1)
    tiles[::_CELL_PX] = lines
    tiles[:, ::_CELL_PX] = np.repeat(border[cells], _CELL_PX, axis=0)
    return tiles
