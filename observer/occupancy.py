"""Map of the ground around a robot: which cells are free, blocked or unknown."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Pose

# States of a cell, and how many there are.
UNKNOWN, FREE, BLOCKED = range(3)
STATES: Final = 3
# Seconds: a map is valid until the next one, but no longer than this.
HELD_S: Final = 1.0
# A map with more cells is an error.
_MOST_CELLS: Final = 1 << 20


@dataclass(frozen=True)
class OccupancyMap:
    """Square grid of cells at one instant, in the frame of a robot's odometry.

    Attributes:
        received: the host's monotonic clock at the reception of the newest frame used for it.
        x, y: the grid's corner with the least coordinates, metres.
        cell_m: side of a cell. size: cells along each side of the grid.
        runs: run-length encoding: numbers of consecutive cells that are unknown, free, blocked,
            unknown and so on, 0 for an empty run; y rises from cell to cell, x from row to row.
        robot: x, y, yaw of the robot's base at that frame, metres and radians.

    Raises:
        ValueError: the runs are not those of the grid, or a number is not finite.
    """

    received: float
    x: float
    y: float
    cell_m: float
    size: int
    runs: tuple[int, ...]
    robot: tuple[float, float, float]

    def __post_init__(self) -> None:
        if not 0 < self.size**2 <= _MOST_CELLS:
            raise ValueError(f"a map cannot have {self.size} cells along each side")
        if min(self.runs, default=0) < 0 or sum(self.runs) != self.size**2:
            raise ValueError("the runs of a map must add up to its cells")
        numbers = (self.received, self.x, self.y, self.cell_m, *self.robot)
        if not (all(map(math.isfinite, numbers)) and self.cell_m > 0):
            raise ValueError("a map needs a known position and size")

    @staticmethod
    def of(
        cells: NDArray[np.uint8],
        corner: tuple[float, float],
        cell_m: float,
        robot: tuple[float, float, float],
        received: float,
    ) -> OccupancyMap:
        """Return the map of cells (S, S), indexed by x and y, each one of the states."""
        return OccupancyMap(received, *corner, cell_m, len(cells), _runs(cells.ravel()), robot)

    def cells(self) -> NDArray[np.uint8]:
        """(S, S) state of each cell, indexed by x and y."""
        states = np.arange(len(self.runs)) % STATES
        return np.repeat(states, self.runs).astype(np.uint8).reshape(self.size, self.size)

    def placed(self, T_world_base: Pose) -> Pose:
        """Return ``T_world_corner``: the grid's corner, with axes along x, y and up.

        Args:
            T_world_base: the robot at the instant of the map.
        """
        x, y, yaw = self.robot
        T_odometry_base = Pose.from_rotvec([0.0, 0.0, yaw], [x, y, 0.0])
        T_odometry_corner = Pose.from_rotvec([0.0, 0.0, 0.0], [self.x, self.y, 0.0])
        return T_world_base @ T_odometry_base.inverse() @ T_odometry_corner


def _runs(states: NDArray[np.uint8]) -> tuple[int, ...]:
    """Return the run lengths of the states, which take turns."""
    begins = np.flatnonzero(np.diff(states, prepend=STATES))
    lengths = np.diff(begins, append=len(states))
    of = states[begins].astype(np.intp)
    # States skipped between two runs get a run of length 0.
    places = np.cumsum(np.concatenate([of[:1], np.diff(of) % STATES]))
    runs = np.zeros(int(places[-1]) + 1, np.intp)
    runs[places] = lengths
    return tuple(runs.tolist())
