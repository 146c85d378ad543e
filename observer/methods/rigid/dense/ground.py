"""The ground: found in dense disparity, and kept as a plane in the world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.kernels.ground import LEAST_SAMPLES, fit_ground, nearer_downwards, stands_out
from observer.methods.rigid.dense.grid import LEAST_COLUMNS, NEAR_M, Grid
from observer.mount import CameraMount

# Samples that are fitted, and triples of them that are tried for a first plane.
_SAMPLES = 700
_TRIES = 60
# Half the rows over which the ground must come nearer downwards: walls do not.
_HALF_ROWS = 4
_SAMPLE_STEP = 2
# Most by which a cell that fits a plane may differ: matched columns, plus a share of the disparity.
_TOLERANCE_COLUMNS, _TOLERANCE_SHARE = 0.25, 0.03
# A camera stands between these heights above the ground, metres.
_HEIGHT_M = (0.03, 4.0)
_GAIN = 0.1
# Least by which a cell stands out of the ground: matched columns, plus a share of the disparity.
_STANDING_COLUMNS, _STANDING_SHARE = 0.5, 0.05
# Matched columns: with so large a disparity cells are judged however far away, as noise is a small
# share of it.
_PRECISE_COLUMNS = 4.0
# Most by which a point on the ground may be nearer than the plane: px, plus a share of the
# disparity.
_LYING_PX, _LYING_SHARE = 0.15, 0.03
# Matched columns: disparity of points above which it alone tells whether they approach or recede;
# and where light flickers, which shifts matches.
_TELLING_COLUMNS, _TELLING_IN_FLICKER_COLUMNS = 3.5, 5.0


@dataclass(frozen=True, eq=False)
class GroundPlane:
    """A plane in the world or in a camera's frame: the places with ``down . X = depth``.

    Attributes:
        down: (3,) unit length. depth: metres.
        mounted: the mount tells it; what is only seen may be a table.
    """

    down: Float64Array
    depth: float
    mounted: bool = False

    def mapped(self, T_target_source: Pose) -> GroundPlane:
        """Return the same plane in another frame; in a camera's frame, its depth is the height."""
        down = T_target_source.rotate(self.down)
        depth = self.depth + float(down @ T_target_source.translation)
        return GroundPlane(down, depth, self.mounted)

    def height(self, place: Float64Array) -> float:
        """Return how high a place (3,) m, world, is above it, metres."""
        return self.depth - float(self.down @ place)

    def carries(
        self,
        px: NDArray[np.float32],
        disparity: Float64Array,
        T_camera_world: Pose,
        camera: StereoCamera,
    ) -> NDArray[np.bool_]:
        """Return which points of an image lie on it, as shadows do, or below, as mirror images do.

        None does if the mount is unknown; points of unknown disparity do not count.

        Args:
            px: (N, 2) and disparity: (N,) px, of the points. T_camera_world: the pose from which
                they are seen.
        """
        below = self.mapped(T_camera_world)
        if not below.mounted or below.depth < _HEIGHT_M[0]:
            return np.zeros(len(px), np.bool_)
        rays = camera.triangulate(px, np.full(len(px), camera.fb))
        level = camera.fb / below.depth * (rays @ below.down)
        return np.asarray(disparity <= level * (1 + _LYING_SHARE) + _LYING_PX, np.bool_)


class Ground:
    """The ground in the world of a recording's segment; unknown until it is seen or a mount given.

    Attributes:
        in_world: the plane itself; None if unknown.
    """

    def __init__(self, grid: Grid, mount: CameraMount | None) -> None:
        """``mount`` gives the ground below the camera in the segment's first frame."""
        self._grid = grid
        self._fb = grid.camera.fb
        self.in_world = None if mount is None else GroundPlane(mount.down, mount.height_m, True)

    def plane(self, T_camera_world: Pose) -> Float64Array | None:
        """(3,) a, b, c of its disparity ``a column + b row + c`` px, from a pose; None unknown."""
        if self.in_world is None:
            return None
        below = self.in_world.mapped(T_camera_world)
        if below.depth < _HEIGHT_M[0]:
            return None
        return np.asarray(self._fb / below.depth * (below.down @ self._grid.rays))

    def update(self, disparity: NDArray[np.float32], T_camera_world: Pose, seed: int) -> None:
        """Fit it to disparities (h, w) px seen from a pose; ``seed`` fixes the random choices."""
        rng = np.random.default_rng(seed)
        at, seen = self._samples(disparity, rng)
        if len(seen) < LEAST_SAMPLES:
            return
        plane = self.plane(T_camera_world)
        normal = fit_ground(
            at,
            seen,
            self._grid.width,
            _TOLERANCE_COLUMNS * self._grid.column_px,
            _TOLERANCE_SHARE,
            rng.integers(0, len(seen), (_TRIES if plane is None else 0, 3)),
            np.zeros(3) if plane is None else plane,
            self._grid.rays,
            self._fb,
        )
        if np.isfinite(normal[0]):
            self._keep(normal, T_camera_world)

    def _samples(
        self, disparity: NDArray[np.float32], rng: np.random.Generator
    ) -> tuple[NDArray[np.intp], Float64Array]:
        """(N,) indices and (N,) px of cells where the scene comes nearer downwards."""
        # Half the rise in disparity of the ground below the highest camera.
        slope = self._grid.camera.baseline * self._grid.reduction / _HEIGHT_M[1]
        rise = np.float32(_HALF_ROWS * slope)
        top = disparity.shape[0] // 4
        found = nearer_downwards(disparity, top, _HALF_ROWS, _SAMPLE_STEP, rise)
        if len(found) < LEAST_SAMPLES:
            return found[:0], np.zeros(0)
        at = found[rng.integers(0, len(found), _SAMPLES)]
        seen = disparity.ravel()[at].astype(np.float64)
        known = np.isfinite(seen)
        return at[known], seen[known]

    def _keep(self, normal: Float64Array, T_camera_world: Pose) -> None:
        height = 1 / float(np.linalg.norm(normal))
        found = GroundPlane(normal * height, height).mapped(T_camera_world.inverse())
        down, depth, mounted = found.down, found.depth, False
        if self.in_world is not None:
            mounted = self.in_world.mounted
            down = self.in_world.down + _GAIN * (down - self.in_world.down)
            depth = self.in_world.depth + _GAIN * (depth - self.in_world.depth)
        self.in_world = GroundPlane(down / np.linalg.norm(down), depth, mounted)


def above_ground(
    disparity: NDArray[np.float32], plane: Float64Array | None, grid: Grid
) -> NDArray[np.bool_]:
    """(h, w) which cells are nearer than the ground, by more than noise.

    Shadows lie on it and reflections below it, so neither counts, nor do unknown cells. If the
    ground is unknown, all other cells count.

    Args:
        disparity: (h, w) px, NaN unknown. plane: as of ``Ground.plane``.
    """
    if plane is None:
        return np.isfinite(disparity)
    share, least = np.float32(1 - _STANDING_SHARE), np.float32(_STANDING_COLUMNS * grid.column_px)
    return stands_out(disparity, plane.astype(np.float32), share, least)


def near_enough(disparity: NDArray[np.float32], grid: Grid) -> NDArray[np.bool_]:
    """(h, w) which cells are so near that noise is a small share of their depth.

    Args:
        disparity: (h, w) px, NaN unknown.
    """
    return np.asarray(disparity > np.float32(_judged_px(grid)), np.bool_)


def tells_approach(disparity: float, grid: Grid, *, flickers: bool = False) -> bool:
    """Return whether points of this disparity, px, tell by it alone if they approach or recede.

    Args:
        flickers: whether the light does.
    """
    columns = _TELLING_IN_FLICKER_COLUMNS if flickers else _TELLING_COLUMNS
    return disparity > max(_judged_px(grid), columns * grid.column_px)


def _judged_px(grid: Grid) -> float:
    """Return the least disparity, px, of cells that are near enough to be judged."""
    least, most = LEAST_COLUMNS * grid.column_px, _PRECISE_COLUMNS * grid.column_px
    return min(max(least, grid.camera.fb / NEAR_M), most)
