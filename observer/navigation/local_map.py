"""Static obstacles around the robot: surfaces that its cameras and its sonar saw lately."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.guard.dead_reckoning import inverse, moved
from observer.guard.sight import FreeScan, SeenObstacle
from observer.occupancy import BLOCKED, FREE, OccupancyMap
from observer.robots.contract import SonarReading

CELL_M: Final = 0.1
# Cells on each side of the robot.
_HALF: Final = 50
_SIZE: Final = 2 * _HALF + 1
# A surface is static if it was seen in one place for this long, with gaps no longer than this.
# Others are ignored: the robot would drive around places that people have walked past, and for
# such a short time the guard handles whatever is new ahead.
_STATIC_S: Final = 0.6
_GAP_S: Final = 0.5
# Time for which it is remembered where nothing newer is seen.
_REMEMBERED_S: Final = 10.0
# Sonar cannot tell whether its echo came from a person, so only near echoes count, and briefly.
_ECHO_S: Final = 1.0
_ECHO_M: Final = 1.5
# Surfaces at neighbouring bearings that are closer together than this are one surface.
_ONE_SURFACE_M: Final = 0.4
# The surface of a tracked obstacle lies within its circle enlarged by this.
_BESIDE_TRACK_M: Final = 0.2
_NEVER: Final = -math.inf


class LocalMap:
    """Square grid around the robot in the frame of its odometry; it reads no clock.

    A cell is blocked where a static surface was seen and nothing newer shows that it is free.
    Unknown cells are not blocked: it is the guard that requires ground known to be free. Which
    cells were seen to be free is kept only for display (``snapshot``).
    """

    def __init__(self) -> None:
        self._corner = np.full(2, -_HALF, np.int64)
        # For each cell: when a surface was first and last seen there without a gap, and until when
        # it counts as blocked.
        self._since, self._last, self._until = (np.full((_SIZE, _SIZE), _NEVER) for _ in range(3))
        # When each cell was last seen to be free.
        self._free = np.full((_SIZE, _SIZE), _NEVER)

    def move_to(self, x: float, y: float) -> None:
        """Centre the grid on a place, metres; cells that leave it are forgotten."""
        corner = np.floor(np.array([x, y]) / CELL_M).astype(np.int64) - _HALF
        shift = corner - self._corner
        self._corner = corner
        if not shift.any():
            return
        self._since, self._last, self._until, self._free = (
            _shifted(grid, shift) for grid in (self._since, self._last, self._until, self._free)
        )

    def see(
        self, scan: FreeScan, tracks: Sequence[SeenObstacle], pose: Float64Array, time: float
    ) -> None:
        """Take in the free floor and surfaces of a frame.

        Args:
            tracks: obstacles in the base frame, whose surfaces are not remembered.
            pose: (3,) x, y, yaw of the base. time: of the frame, seconds.
        """
        bearings = np.array(scan.bearings)
        blocked = np.array([math.inf if far is None else far for far in scan.blocked_m])
        rays = _rays(bearings, np.array(scan.known_from_m), np.array(scan.known_to_m))
        self._clear(rays, pose, time)
        self._block(_without(_surfaces(bearings, blocked), tracks), pose, time, _REMEMBERED_S)

    def hear(self, sonars: Sequence[SonarReading], then: Float64Array, pose: Float64Array) -> None:
        """Take in near echoes, which are soon forgotten.

        Args:
            then: (S, 3) pose of the base as it stands now, in that of each reading.
            pose: (3,) x, y, yaw of the base now.
        """
        for each, since in zip(sonars, then, strict=True):
            if each.range_m is None or each.range_m >= _ECHO_M:
                continue
            x = each.x + each.range_m * math.cos(each.heading)
            y = each.y + each.range_m * math.sin(each.heading)
            echo = moved(np.array([[x, y]]), np.array(inverse(since)))
            self._block(echo, pose, each.received, _ECHO_S)

    def stand(self, track: SeenObstacle, until: float) -> None:
        """Block the circle of a stationary track, given in the frame of the map."""
        angles = np.linspace(0.0, 2 * math.pi, 16, endpoint=False)
        rings = [share * track.radius_m for share in (0.0, 0.35, 0.7, 1.0)]
        x = np.concatenate([track.x + ring * np.cos(angles) for ring in rings])
        y = np.concatenate([track.y + ring * np.sin(angles) for ring in rings])
        at = self._cells(np.stack([x, y], axis=1), np.zeros(3))
        self._until[at] = np.maximum(self._until[at], until)

    def blocked(self, time: float) -> NDArray[np.bool_]:
        """(S, S) which cells are blocked, by x and y."""
        return np.asarray(self._until > time)

    def snapshot(self, pose: Float64Array, time: float) -> OccupancyMap:
        """Return which cells are known to be free or blocked; the others are unknown.

        A free cell where a surface was seen since that is not static yet is unknown.

        Args:
            pose: (3,) x, y, yaw of the base. time: of the newest frame, seconds.
        """
        cells = np.zeros((_SIZE, _SIZE), np.uint8)
        cells[(self._free > self._last) & (self._free > time - _REMEMBERED_S)] = FREE
        cells[self.blocked(time)] = BLOCKED
        x, y = (self._corner * CELL_M).tolist()
        at, beside, yaw = pose.tolist()
        return OccupancyMap.of(cells, (x, y), CELL_M, (at, beside, yaw), time)

    def cell(self, places: Float64Array) -> Float64Array:
        """(..., 2) cell coordinates in ``blocked`` of places in metres; not clipped to the grid."""
        return np.asarray(places / CELL_M - self._corner - 0.5)

    def clearance(self, places: Float64Array, time: float) -> Float64Array:
        """(...,) metres from places (..., 2) to the nearest surface, at most 2.

        Args:
            time: seconds; surfaces that are out of date by then are ignored.
        """
        blocked = self.blocked(time)
        if not blocked.any():
            return np.full(places.shape[:-1], 2.0)
        far = cv2.distanceTransform((~blocked).astype(np.uint8), cv2.DIST_L2, 5) * CELL_M
        at = np.clip(np.round(self.cell(places)), 0, _SIZE - 1).astype(np.intp)
        return np.minimum(far[at[..., 0], at[..., 1]].astype(np.float64), 2.0)

    def _block(
        self, points: Float64Array, pose: Float64Array, time: float, remembered_s: float
    ) -> None:
        """Take in surfaces seen at ``time``; static ones are remembered for ``remembered_s``."""
        x, y = self._cells(points, pose)
        begins = time - self._last[x, y] > _GAP_S
        self._since[x, y] = np.where(begins, time, self._since[x, y])
        self._last[x, y] = np.maximum(self._last[x, y], time)
        static = time - self._since[x, y] >= _STATIC_S
        x, y = x[static], y[static]
        self._until[x, y] = np.maximum(self._until[x, y], time + remembered_s)

    def _clear(self, points: Float64Array, pose: Float64Array, time: float) -> None:
        x, y = self._cells(points, pose)
        self._free[x, y] = time
        for grid in (self._since, self._last, self._until):
            grid[x, y] = _NEVER

    def _cells(self, points: Float64Array, pose: Float64Array) -> tuple[NDArray[np.intp], ...]:
        """Indices of the cells in which points (N, 2) of the base frame lie, within the grid."""
        at = np.floor(moved(points, pose) / CELL_M).astype(np.int64) - self._corner
        inside = ((at >= 0) & (at < _SIZE)).all(axis=1)
        return at[inside, 0], at[inside, 1]


def _shifted(grid: Float64Array, shift: NDArray[np.int64]) -> Float64Array:
    moved = np.full_like(grid, _NEVER)
    if (np.abs(shift) < _SIZE).all():
        (to_x, from_x), (to_y, from_y) = (_overlap(int(each)) for each in shift)
        moved[to_x, to_y] = grid[from_x, from_y]
    return moved


def _overlap(shift: int) -> tuple[slice, slice]:
    """Return the target and the source slice of a shift along one axis."""
    if shift >= 0:
        return slice(0, _SIZE - shift), slice(shift, _SIZE)
    return slice(-shift, _SIZE), slice(0, _SIZE + shift)


def _rays(bearings: Float64Array, near: Float64Array, far: Float64Array) -> Float64Array:
    """(N, 2) points half a cell apart along the free part of each direction, and between them.

    Between two neighbouring directions the worse one counts.
    """
    bearings = np.concatenate([bearings, (bearings[:-1] + bearings[1:]) / 2])
    near = np.concatenate([near, np.maximum(near[:-1], near[1:])])
    far = np.concatenate([far, np.minimum(far[:-1], far[1:])])
    steps = np.arange(0.0, 6.0, CELL_M / 2)
    # Stop a cell short of the end, so that a surface's own cell is not cleared.
    free = (steps >= near[:, None]) & (steps <= far[:, None] - CELL_M)
    at, step = np.nonzero(free)
    distance, bearing = steps[step], bearings[at]
    return np.stack([distance * np.cos(bearing), distance * np.sin(bearing)], axis=1)


def _surfaces(bearings: Float64Array, blocked: Float64Array) -> Float64Array:
    """(N, 2) points on the surfaces, also between neighbouring directions on the same surface."""
    seen = np.isfinite(blocked)
    reach = np.where(seen, blocked, 0.0)
    points = np.stack([reach * np.cos(bearings), reach * np.sin(bearings)], axis=1)
    a, b = points[:-1], points[1:]
    both = seen[:-1] & seen[1:] & (np.hypot(*(b - a).T) < _ONE_SURFACE_M)
    between = [a[both] + share * (b - a)[both] for share in (0.25, 0.5, 0.75)]
    return np.concatenate([points[seen], *between])


def _without(points: Float64Array, tracks: Sequence[SeenObstacle]) -> Float64Array:
    """Points (N, 2) without those on tracked obstacles."""
    for one in tracks:
        away = np.hypot(points[:, 0] - one.x, points[:, 1] - one.y)
        points = points[away > one.radius_m + _BESIDE_TRACK_M]
    return points
