"""Finds points on bodies that something nearer begins to hide."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.cells_around import cells_around
from observer.methods.rigid.camera_step import CameraStep
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.tracked_points import BANISHED_FRAMES, TrackedPoints
from observer.vision.lifecycle import NO_OBSTACLE


def without_hidden(
    tracks: list[BodyTrack], points: TrackedPoints, scene: DenseScene, now: CameraStep
) -> TrackedPoints:
    """Return the points; those that something nearer begins to hide have left their rigid bodies.

    Their patches stick to the edge of what hides them, and would hold the body back.
    """
    rigid = [t for t in tracks if t.rigid]
    members = np.flatnonzero(np.isin(points.obstacle, [t.id for t in rigid]))
    if len(members) == 0:
        return points
    obstacle, tenure = points.obstacle.copy(), points.tenure.copy()
    beside = _nearest_beside(scene, points.px[members])
    for track in rigid:
        mine = obstacle[members] == track.id
        if not mine.any():
            continue
        _, corners = now.camera.project(now.T_camera_world.apply(track.corners()))
        if not np.isfinite(corners).all():
            continue
        own = float(corners.max())
        hidden = members[mine & (beside > own + scene.tolerance(own))]
        obstacle[hidden], tenure[hidden] = NO_OBSTACLE, -BANISHED_FRAMES
    return points.but(obstacle=obstacle, tenure=tenure)


def _nearest_beside(scene: DenseScene, px: NDArray[np.float32]) -> NDArray[np.float32]:
    """(N,) largest disparity of what stands at or next to the cells of pixels (N, 2); 0 if none."""
    cells = cells_around(scene.grid, px, 1)
    disparity = scene.disparity[cells]
    known = np.where(scene.standing[cells] & np.isfinite(disparity), disparity, 0)
    return np.asarray(known.max(axis=1), np.float32)
