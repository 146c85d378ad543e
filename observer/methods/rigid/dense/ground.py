"""The ground: found in dense disparity, and kept as a plane of the world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array, Pose
from observer.methods.rigid.dense.grid import Grid
from observer.mount import CameraMount

# Samples that are fitted, and triples of them that are tried for a first plane.
_SAMPLES = 700
_TRIES = 60
_LEAST_SAMPLES = 150
# Half the rows over which the ground must be seen to come nearer: walls do not.
_HALF_ROWS = 4
_SAMPLE_STEP = 2
# What fits a plane: cells, and as a share of the disparity.
_TOLERANCE_CELLS, _TOLERANCE_SHARE = 0.25, 0.03
# A camera stands between these heights above the ground, metres, about level sideways, and looks
# neither straight up nor, unless a mount says so, straight down.
_HEIGHT_M = (0.03, 4.0)
_MAX_ROLL, _MAX_UP, _LEAST_DOWN = 0.4, 0.5, 0.3
# Of what comes nearer downwards so much must be the ground, where no mount tells of it.
_FOUND_SHARE = 0.5
_GAIN = 0.1
# What stands out of it: cells, and as a share of the disparity.
_STANDING_CELLS, _STANDING_SHARE = 0.5, 0.05
# Disparity, in cells, of what is near enough to be judged.
_NEAR_CELLS = 4.0


@dataclass(frozen=True, eq=False)
class GroundPlane:
    """A plane in the world or in a camera's frame: the places with ``down . X = depth``.

    Attributes:
        down: (3,) unit length. depth: metres.
    """

    down: Float64Array
    depth: float

    def mapped(self, T_target_source: Pose) -> GroundPlane:
        """Return the same plane in another frame; in a camera's, its depth is the height."""
        down = T_target_source.rotate(self.down)
        return GroundPlane(down, self.depth + float(down @ T_target_source.translation))

    def height(self, place: Float64Array) -> float:
        """Return how high a place (3,) m, world, is above it, metres."""
        return self.depth - float(self.down @ place)


class Ground:
    """The ground of a segment's world; unknown until it is seen or mounted.

    Attributes:
        in_world: the plane itself; None unknown.
    """

    def __init__(self, grid: Grid, mount: CameraMount | None) -> None:
        """``mount`` tells the ground below the camera of the segment's first frame."""
        self._grid = grid
        self._focal = grid.camera.fx * grid.camera.baseline
        self.in_world = None if mount is None else GroundPlane(mount.down, mount.height_m)

    def plane(self, T_camera_world: Pose) -> Float64Array | None:
        """(3,) a, b, c of its disparity ``a column + b row + c`` px, from a pose; None unknown."""
        if self.in_world is None:
            return None
        below = self.in_world.mapped(T_camera_world)
        if below.depth < _HEIGHT_M[0]:
            return None
        return np.asarray(self._focal / below.depth * (below.down @ self._grid.rays))

    def update(self, disparity: NDArray[np.float32], T_camera_world: Pose, seed: int) -> None:
        """Fit it to what is seen (h, w) px from a pose; random choices follow from ``seed``."""
        rng = np.random.default_rng(seed)
        at, seen = self._samples(disparity, rng)
        if len(seen) < _LEAST_SAMPLES:
            return
        tolerance = _TOLERANCE_CELLS * self._grid.reduction + _TOLERANCE_SHARE * seen
        plane = self.plane(T_camera_world)
        if plane is None:
            plane = self._found(at, seen, tolerance, rng)
        for _ in range(2):
            if plane is None:
                return
            plane = _refit(plane, at, seen, tolerance)
        if plane is not None and self._plausible(plane[None])[0]:
            self._keep(plane, T_camera_world)

    def _samples(
        self, disparity: NDArray[np.float32], rng: np.random.Generator
    ) -> tuple[Float64Array, Float64Array]:
        """(N, 3) column, row, 1 and (N,) px of cells that come nearer downwards."""
        top = disparity.shape[0] // 4
        low, step = disparity[top:], _SAMPLE_STEP
        with np.errstate(invalid="ignore"):
            rise = low[2 * _HALF_ROWS :: step, ::step] - low[: -2 * _HALF_ROWS : step, ::step]
            # Half of what the ground below the highest camera rises by.
            slope = self._grid.camera.baseline * self._grid.reduction / _HEIGHT_M[1]
            rows, columns = np.nonzero(rise > _HALF_ROWS * slope)
        if len(rows) < _LEAST_SAMPLES:
            return np.zeros((0, 3)), np.zeros(0)
        chosen = rng.integers(0, len(rows), _SAMPLES)
        column, row = step * columns[chosen], step * rows[chosen] + top + _HALF_ROWS
        seen = disparity[row, column].astype(np.float64)
        known = np.isfinite(seen)
        at = np.stack([column, row, np.ones_like(row)], axis=1)[known].astype(np.float64)
        return at, seen[known]

    def _found(
        self,
        at: Float64Array,
        seen: Float64Array,
        tolerance: Float64Array,
        rng: np.random.Generator,
    ) -> Float64Array | None:
        """Find the plane on which most lie and below which least (RANSAC); None if too few do."""
        chosen = rng.integers(0, len(seen), (_TRIES, 3))
        triples = at[chosen]
        apart = np.abs(np.linalg.det(triples)) > 1.0
        planes = np.linalg.solve(triples[apart], seen[chosen][apart][..., None])[..., 0]
        planes = planes[self._plausible(planes)]
        if len(planes) == 0:
            return None
        above = seen - planes @ at.T
        on = np.count_nonzero(np.abs(above) < tolerance, axis=1)
        below = np.count_nonzero(above < -2 * tolerance, axis=1)
        best = int(np.argmax(on - below))
        return planes[best] if on[best] >= _FOUND_SHARE * len(seen) else None

    def _normals(self, planes: Float64Array) -> Float64Array:
        """(N, 3) 1/m normals, over the camera's height, of planes (N, 3) as of ``plane``."""
        return np.asarray(np.linalg.solve(self._grid.rays.T, planes.T).T / self._focal)

    def _plausible(self, planes: Float64Array) -> NDArray[np.bool_]:
        normals = self._normals(planes)
        length = np.maximum(np.linalg.norm(normals, axis=1), 1e-9)
        x, y, z = (normals / length[:, None]).T
        level = (np.abs(x) < _MAX_ROLL) & (y > _LEAST_DOWN) & (z > -_MAX_UP)
        return np.asarray(level & (1 / length > _HEIGHT_M[0]) & (1 / length < _HEIGHT_M[1]))

    def _keep(self, plane: Float64Array, T_camera_world: Pose) -> None:
        normal = self._normals(plane[None])[0]
        height = 1 / float(np.linalg.norm(normal))
        found = GroundPlane(normal * height, height).mapped(T_camera_world.inverse())
        down, depth = found.down, found.depth
        if self.in_world is not None:
            down = self.in_world.down + _GAIN * (down - self.in_world.down)
            depth = self.in_world.depth + _GAIN * (depth - self.in_world.depth)
        self.in_world = GroundPlane(down / np.linalg.norm(down), depth)


def _refit(
    plane: Float64Array, at: Float64Array, seen: Float64Array, tolerance: Float64Array
) -> Float64Array | None:
    """(3,) the plane of least squares through what lies on a plane; None if too little does."""
    on = np.abs(seen - at @ plane) < tolerance
    if np.count_nonzero(on) < _LEAST_SAMPLES:
        return None
    weighted = at[on] / tolerance[on, None]
    return np.asarray(np.linalg.lstsq(weighted, seen[on] / tolerance[on], rcond=None)[0])


def standing(
    disparity: NDArray[np.float32], plane: Float64Array | None, grid: Grid
) -> NDArray[np.bool_]:
    """(h, w) which cells stand out of the ground: nearer than it, by more than noise.

    What is so far away that noise would be a large share of its depth is left out.

    Shadows lie on it and reflections below it, so neither stands. Unknown cells do not; where the
    ground is unknown, all others do.

    Args:
        disparity: (h, w) px, NaN unknown. plane: as of ``Ground.plane``.
    """
    near = disparity > _NEAR_CELLS * grid.reduction
    if plane is None:
        return near
    height, width = disparity.shape
    a, b, c = plane.astype(np.float32)
    rows = b * np.arange(height, dtype=np.float32) + c
    ground = a * np.arange(width, dtype=np.float32) + rows[:, None]
    with np.errstate(invalid="ignore"):
        above = disparity * np.float32(1 - _STANDING_SHARE) - np.maximum(ground, np.float32(0))
        return np.asarray(near & (above > _STANDING_CELLS * grid.reduction))
