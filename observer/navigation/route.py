"""Route to the goal around static obstacles: distance from each place along free cells."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from observer.geometry import Float64Array
from observer.navigation.local_map import CELL_M, LocalMap

# Cells of the map along each side of one coarse cell of the route.
_COARSE: Final = 2
# Cost factor of cells that are too narrow for the robot: it finds a way out of them, but avoids
# going through.
_NARROW: Final = 30.0
# Near a surface a route costs more: out to this distance beyond the robot's radius, and by at most
# this share.
_BESIDE_M: Final = 0.3
_BESIDE: Final = 1.0


@dataclass(frozen=True, eq=False)
class Route:
    """Distances to a goal.

    Attributes:
        left_m: (S, S) metres from each coarse cell of the map.
    """

    map: LocalMap
    goal: tuple[float, float]
    left_m: Float64Array

    def distance(self, places: Float64Array) -> Float64Array:
        """(...,) metres to drive from places (..., 2); outside the map the straight distance."""
        at = (self.map.cell(places) + 0.5) / _COARSE - 0.5
        flat = at.reshape(-1, 2)
        inside = ((flat >= 0) & (flat <= len(self.left_m) - 1)).all(axis=1)
        along = map_coordinates(self.left_m, flat.T, order=1, mode="nearest")
        beeline = np.hypot(*(places.reshape(-1, 2) - self.goal).T)
        return np.where(inside, along, beeline).reshape(places.shape[:-1])

    def heading(self, x: float, y: float, reach_m: float) -> float:
        """Return the direction from a place that most reduces the distance to drive, radians.

        Args:
            reach_m: distance at which the reduction is compared.
        """
        bearing = math.atan2(self.goal[1] - y, self.goal[0] - x)
        away = min(reach_m, math.hypot(self.goal[0] - x, self.goal[1] - y))
        # The beeline comes first: it wins where others are hardly shorter.
        angles = bearing + np.radians(np.arange(0, 360, 10))
        ring = np.stack([x + away * np.cos(angles), y + away * np.sin(angles)], axis=1)
        left = self.distance(ring)
        best = int(np.argmin(left))
        return bearing if left[0] <= left[best] + CELL_M / 2 else float(angles[best])


def route(local: LocalMap, goal: tuple[float, float], radius_m: float, time: float) -> Route:
    """Return the distances to a goal by Dijkstra's algorithm on the map's cells.

    Args:
        goal: x, y metres. radius_m: clearance that the robot needs on each side. time: seconds.
    """
    cost = _cost(local.blocked(time), radius_m)
    size = len(cost)
    index = np.arange(size * size).reshape(size, size)
    rows, columns, weights = [], [], []
    for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1)):
        a, b = _neighbours(index, dx, dy)
        step = math.hypot(dx, dy) * _COARSE * CELL_M
        rows.append(a)
        columns.append(b)
        weights.append(step * (cost.ravel()[a] + cost.ravel()[b]) / 2)
    # The goal is an extra node, linked to the cells nearest to it.
    tied, far = _ties(local, goal, size)
    rows.append(tied)
    columns.append(np.full(len(tied), size * size))
    weights.append(far)
    graph = coo_array(
        (np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns))),
        shape=(size * size + 1, size * size + 1),
    ).tocsr()
    left = dijkstra(graph, directed=False, indices=np.array([size * size]))[0, :-1]
    return Route(local, goal, left.reshape(size, size))


def _cost(blocked: NDArray[np.bool_], radius_m: float) -> Float64Array:
    """(S, S) cost per metre in each coarse cell."""
    far = cv2.distanceTransform((~blocked).astype(np.uint8), cv2.DIST_L2, 5) * CELL_M
    if not blocked.any():
        far[:] = math.inf
    size = len(blocked) // _COARSE
    trimmed = far[: size * _COARSE, : size * _COARSE].reshape(size, _COARSE, size, _COARSE)
    near = trimmed.min(axis=(1, 3)).astype(np.float64)
    beside = np.clip(1 - (near - radius_m) / _BESIDE_M, 0.0, 1.0)
    return np.where(near < radius_m, _NARROW, 1 + _BESIDE * beside)


def _neighbours(index: NDArray[np.intp], dx: int, dy: int) -> tuple[NDArray[np.intp], ...]:
    size = len(index)
    if dy >= 0:
        return index[: size - dx, : size - dy].ravel(), index[dx:, dy:].ravel()
    return index[: size - dx, -dy:].ravel(), index[dx:, :dy].ravel()


def _ties(
    local: LocalMap, goal: tuple[float, float], size: int
) -> tuple[NDArray[np.intp], Float64Array]:
    """Return the cells that are linked straight to the goal, and their distances from it.

    For a goal within the map those around it, else the map's whole border.
    """
    at = (local.cell(np.array(goal)) + 0.5) / _COARSE - 0.5
    grid = np.stack(np.meshgrid(np.arange(size), np.arange(size), indexing="ij"), axis=-1)
    far = np.hypot(*np.moveaxis(grid - at, -1, 0)) * _COARSE * CELL_M
    border = (grid == 0).any(axis=-1) | (grid == size - 1).any(axis=-1)
    inside = bool(((at >= 0) & (at <= size - 1)).all())
    tied = far < 1.5 * _COARSE * CELL_M if inside else border
    return np.flatnonzero(tied), far[tied]
