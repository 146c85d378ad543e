"""Oracle of ``observer.kernels.ground``: the same by numpy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.methods.rigid.dense.grid import Grid

_LEAST_SAMPLES = 150
# Metres: range of a camera's height above the ground; it is about level sideways and looks
# neither straight up nor, unless a mount says so, straight down.
_HEIGHT_M = (0.03, 4.0)
_MAX_ROLL, _MAX_UP, _LEAST_DOWN = 0.4, 0.5, 0.3
# Share of what is seen that must be ground if no plane is expected.
_FOUND_SHARE = 0.5


def nearer_downwards(
    disparity: NDArray[np.float32], top: int, half_rows: int, step: int, rise: float
) -> NDArray[np.intp]:
    """(N,) indices of cells where the scene is nearer below than above."""
    low = disparity[top:]
    more = low[2 * half_rows :: step, ::step] - low[: -2 * half_rows : step, ::step]
    rows, columns = np.nonzero(more > rise)
    at: NDArray[np.intp] = (step * rows + top + half_rows) * disparity.shape[1] + step * columns
    return at


def fit_ground(
    grid: Grid,
    at: Float64Array,
    seen: Float64Array,
    tolerance: Float64Array,
    triples: NDArray[np.intp],
    expected: Float64Array | None,
) -> Float64Array | None:
    """(3,) normal over height of the plane through cells (N, 3): column, row, 1; or None.

    Args:
        seen: (N,) px. tolerance: (N,) px by which each may be off it. triples: (T, 3).
    """
    plane = _found(grid, at, seen, tolerance, triples) if expected is None else expected
    for _ in range(2):
        if plane is None:
            return None
        plane = _refit(plane, at, seen, tolerance)
    if plane is None or not _plausible(grid, plane[None])[0]:
        return None
    return np.asarray(_normals(grid, plane[None])[0], np.float64)


def _found(
    grid: Grid,
    at: Float64Array,
    seen: Float64Array,
    tolerance: Float64Array,
    triples: NDArray[np.intp],
) -> Float64Array | None:
    apart = np.abs(np.linalg.det(at[triples])) > 1.0 + 1e-9
    planes = np.linalg.solve(at[triples][apart], seen[triples][apart][..., None])[..., 0]
    planes = planes[_plausible(grid, planes)]
    if len(planes) == 0:
        return None
    above = seen - planes @ at.T
    on = np.count_nonzero(np.abs(above) < tolerance, axis=1)
    below = np.count_nonzero(above < -2 * tolerance, axis=1)
    best = int(np.argmax(on - below))
    return np.asarray(planes[best]) if on[best] >= _FOUND_SHARE * len(seen) else None


def _normals(grid: Grid, planes: Float64Array) -> Float64Array:
    focal = grid.camera.fx * grid.camera.baseline
    return np.asarray(np.linalg.solve(grid.rays.T, planes.T).T / focal)


def _plausible(grid: Grid, planes: Float64Array) -> NDArray[np.bool_]:
    normals = _normals(grid, planes)
    length = np.maximum(np.linalg.norm(normals, axis=1), 1e-9)
    x, y, z = (normals / length[:, None]).T
    level = (np.abs(x) < _MAX_ROLL) & (y > _LEAST_DOWN) & (z > -_MAX_UP)
    return np.asarray(level & (1 / length > _HEIGHT_M[0]) & (1 / length < _HEIGHT_M[1]))


def _refit(
    plane: Float64Array, at: Float64Array, seen: Float64Array, tolerance: Float64Array
) -> Float64Array | None:
    on = np.abs(seen - at @ plane) < tolerance
    if np.count_nonzero(on) < _LEAST_SAMPLES:
        return None
    weighted = at[on] / tolerance[on, None]
    return np.asarray(np.linalg.lstsq(weighted, seen[on] / tolerance[on], rcond=None)[0])


def stands_out(
    disparity: NDArray[np.float32],
    plane: NDArray[np.float32],
    share: np.float32,
    least: np.float32,
) -> NDArray[np.bool_]:
    """(h, w) which cells stand out as nearer than the ground."""
    height, width = disparity.shape
    a, b, c = plane
    rows = b * np.arange(height, dtype=np.float32) + c
    ground = a * np.arange(width, dtype=np.float32) + rows[:, None]
    above = disparity * share - np.maximum(ground, np.float32(0))
    return np.asarray(above > least)
