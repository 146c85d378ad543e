"""The local map as a picture on the floor: each cell where it is, unknown not drawn."""

from __future__ import annotations

import cv2
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from app.contract.events import LocalMapEvent
from app.contract.scene import LAYERS
from app.viewer.map_tiles import map_tiles, picture_of
from observer.geometry import Pose
from observer.occupancy import BLOCKED, FREE, STATES, UNKNOWN, OccupancyMap

_SIZE = 4
CELLS = arrays(np.uint8, (_SIZE, _SIZE), elements=st.integers(0, STATES - 1))
PLACE = st.floats(-9.0, 9.0)


def local_map(cells: NDArray[np.uint8]) -> OccupancyMap:
    return OccupancyMap.of(cells, (0.4, -0.2), 0.1, (0.0, 0.0, 0.0), 7.0)


@given(CELLS, PLACE, PLACE)
def test_the_centre_of_each_cell_is_drawn_in_place(
    cells: NDArray[np.uint8], x: float, y: float
) -> None:
    local = local_map(cells)
    corner = Pose.from_rotvec([0.0, 0.0, 0.7], [x, y, 0.0])
    tiles = map_tiles(LocalMapEvent(local, corner))
    assert tiles is not None
    picture = cv2.imdecode(np.frombuffer(tiles.png, np.uint8), cv2.IMREAD_UNCHANGED)
    assert picture is not None
    rgba = cv2.cvtColor(picture, cv2.COLOR_BGRA2RGBA)
    np.testing.assert_array_equal(rgba, picture_of(local))
    blocked, free = LAYERS["map"].colors
    for (i, k), state in np.ndenumerate(cells):
        place = np.array([0.1 * i + 0.05, 0.1 * k + 0.05, 0.0])
        # Columns of the picture lie along x, rows along y, both around its middle.
        in_picture = tiles.T_world_middle.inverse().apply(corner.apply(place))
        column, row = (in_picture[:2] / tiles.side_m + 0.5) * len(rgba)
        red, green, blue, alpha = rgba[int(row), int(column)].tolist()
        assert (alpha > 0) == (state != UNKNOWN)
        if state != UNKNOWN:
            assert (red, green, blue) == {FREE: free, BLOCKED: blocked}[int(state)]
        # Below the line layers on the floor.
        assert -0.01 < in_picture[2] < 0.0


def test_without_a_map_or_pose_nothing_is_drawn() -> None:
    cells = np.ones((_SIZE, _SIZE), np.uint8)
    assert map_tiles(None) is map_tiles(LocalMapEvent(None, None)) is None
    assert map_tiles(LocalMapEvent(local_map(cells), None)) is None
