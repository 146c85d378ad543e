"""The occupancy map: its cells survive a round trip, and invalid maps are refused."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from observer.geometry import Pose
from observer.occupancy import BLOCKED, FREE, STATES, OccupancyMap

STATE = st.integers(0, STATES - 1)
CELLS = st.integers(1, 12).flatmap(lambda size: arrays(np.uint8, (size, size), elements=STATE))
PLACE = st.floats(-30.0, 30.0)
ROBOT = st.tuples(PLACE, PLACE, st.floats(-math.pi, math.pi))


@given(CELLS)
def test_every_cell_survives_a_json_round_trip(cells: NDArray[np.uint8]) -> None:
    made = OccupancyMap.of(cells, (0.3, -1.2), 0.1, (0.5, -0.5, 1.0), 7.0)
    np.testing.assert_array_equal(made.cells(), cells)
    assert msgspec.json.decode(msgspec.json.encode(made), type=OccupancyMap) == made
    # Each change of state adds at most one run per state.
    assert len(made.runs) <= STATES * np.count_nonzero(np.diff(cells.ravel())) + STATES


def test_a_room_is_encoded_compactly() -> None:
    cells = np.zeros((101, 101), np.uint8)
    cells[20:60, 30:70] = FREE
    cells[60, 30:70] = BLOCKED
    assert len(msgspec.json.encode(OccupancyMap.of(cells, (0.0, 0.0), 0.1, (0,) * 3, 0.0))) < 600


@given(ROBOT, ROBOT, PLACE, PLACE)
def test_the_map_is_placed_relative_to_the_robot(
    robot: tuple[float, float, float], base: tuple[float, float, float], x: float, y: float
) -> None:
    made = OccupancyMap.of(np.zeros((2, 2), np.uint8), (x, y), 0.1, robot, 0.0)
    T_world_base = Pose.from_rotvec([0.0, 0.0, base[2]], [base[0], base[1], 0.2])
    # The robot itself, relative to the corner of the grid.
    own = [robot[0] - x, robot[1] - y, 0.0]
    np.testing.assert_allclose(made.placed(T_world_base).apply(own), [*base[:2], 0.2], atol=1e-9)


@pytest.mark.parametrize(
    "changes",
    [
        {"size": 0, "runs": ()},
        {"size": 3},
        {"size": 1 << 20, "runs": (1 << 40,)},
        {"runs": (5, -1)},
        {"x": math.nan},
        {"cell_m": 0.0},
        {"robot": (0.0, math.inf, 0.0)},
    ],
)
def test_an_invalid_map_is_refused(changes: dict[str, Any]) -> None:
    made = OccupancyMap.of(np.zeros((2, 2), np.uint8), (0.0, 0.0), 0.1, (0.0, 0.0, 0.0), 0.0)
    with pytest.raises(ValueError, match="map"):
        replace(made, **changes)
