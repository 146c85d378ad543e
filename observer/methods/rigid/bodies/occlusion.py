"""Tells points on bodies that something nearer hides, and points matched with the wrong place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import POSITION
from observer.methods.rigid.camera_step import CameraStep
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.tracked_points import BANISHED_FRAMES, NO_OBSTACLE, TrackedPoints

# Pixels, and share of its disparity, by which a point's depth differs from that of all cells of
# its patch, of which this share is known, before it counts as matched with the wrong place.
_WRONG_PX, _WRONG_SHARE, _WRONG_KNOWN = 2.0, 0.2, 2 / 3
# Cells to each side of a point: those that touch it, and those of the patch it is followed by.
_BESIDE, _PATCH = 1, 3


def without_hidden(
    tracks: list[BodyTrack], points: TrackedPoints, scene: DenseScene, now: CameraStep
) -> TrackedPoints:
    """Return the points; members of rigid bodies that something nearer begins to hide have left.

    Their patches stick to the edge of what hides them, and would hold the body back.
    """
    obstacle, tenure = points.obstacle.copy(), points.tenure.copy()
    for track in [t for t in tracks if t.rigid]:
        mine = np.flatnonzero(obstacle == track.id)
        _, disparity = now.camera.project(now.T_camera_world.apply(track.mean[None, POSITION]))
        if len(mine) == 0 or not np.isfinite(disparity[0]):
            continue
        nearest = _around(scene, points.px[mine], _BESIDE, standing=True)
        nearest = np.where(np.isfinite(nearest), nearest, -np.inf).max(axis=0)
        hidden = mine[nearest > disparity[0] + scene.tolerance(float(disparity[0]))]
        obstacle[hidden], tenure[hidden] = NO_OBSTACLE, -BANISHED_FRAMES
    return points.but(obstacle=obstacle, tenure=tenure)


def at_wrong_depth(points: TrackedPoints, scene: DenseScene | None) -> NDArray[np.bool_]:
    """(N,) which points are nowhere near the depth of the cells around them.

    In the right image they were taken for another part of a pattern. None if nothing is known.
    """
    if scene is None:
        return np.zeros(len(points.px), np.bool_)
    around = _around(scene, points.px, _PATCH, standing=False)
    known = np.isfinite(around)
    off = np.where(known, np.abs(around - points.disparity), np.inf).min(axis=0)
    wrong = off > np.maximum(_WRONG_PX, _WRONG_SHARE * points.disparity)
    return np.asarray(wrong & (known.mean(axis=0) >= _WRONG_KNOWN))


def _around(
    scene: DenseScene, px: NDArray[np.float32], reach: int, *, standing: bool
) -> NDArray[np.float32]:
    """(K, N) disparities of the cells around pixels (N, 2), NaN unknown or not what stands.

    Args:
        reach: cells to each side.
    """
    disparity = np.where(scene.standing, scene.disparity, np.nan) if standing else scene.disparity
    rows, columns = scene.grid.at(px)
    padded = np.pad(disparity, reach, constant_values=np.nan)
    side = range(2 * reach + 1)
    return np.stack([padded[rows + i, columns + j] for i in side for j in side])
