"""Trace of the rigid method; ``observer.observer`` lists its names."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.methods.rigid.point_motion import PointEvidence, PooledMotion
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.trace import Trace
from observer.types import EgoMotion, Matches
from observer.vision.disparity_bias import bias_profile
from observer.vision.klt_tracking import Sightings
from observer.vision.lifecycle import NO_OBSTACLE
from observer.vision.rigid_ego_motion import RigidEgoMotion
from observer.vision.view import StereoRows, View


def keep_background(
    trace: Trace,
    previous: View,
    before: TrackedPoints,
    points: TrackedPoints,
    seen: Sightings,
    ego: EgoMotion,
    rows: StereoRows,
) -> None:
    """Keep the tracked points and the camera's motion, of every frame."""
    trace.keep("previous_time", previous.time)
    trace.keep("previous_left", previous.left)
    trace.keep("previous_right", previous.right)
    trace.keep("features_px", before.px)
    trace.keep_later("matches", lambda: Matches(before.px[seen.found], points.px))
    trace.keep("ego_motion", ego)
    trace.keep("rows", rows)


def keep_motion(
    trace: Trace,
    before: TrackedPoints,
    points: TrackedPoints,
    seen: Sightings,
    ego: RigidEgoMotion,
    motion: PooledMotion,
) -> None:
    """Keep the motion of a frame whose pose is known; most of it is computed on request."""

    @cache
    def flow() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        start = before.px[seen.found].astype(np.float64)
        residual = points.px - ego.predict(start, before.disparity[seen.found])
        return start, residual, np.asarray(np.isfinite(residual).all(axis=1))

    def observed() -> NDArray[np.float32]:
        start, residual, known = flow()
        return np.asarray((start + residual)[known], np.float32)

    def residuals() -> NDArray[np.float32]:
        _, residual, known = flow()
        return np.asarray(residual[known], np.float32)

    def dynamic() -> NDArray[np.bool_]:
        known = flow()[2]
        return np.asarray((motion.dynamic | (_obstacle(points) != NO_OBSTACLE))[known])

    trace.keep_later("flow_px", lambda: flow()[0][flow()[2]])
    trace.keep_later("flow_observed_px", observed)
    trace.keep_later("flow_residual_px", residuals)
    trace.keep_later("dynamic", dynamic)
    trace.keep_later("evidence", lambda: _evidence(points, ego, motion))


def _evidence(points: TrackedPoints, ego: RigidEgoMotion, motion: PooledMotion) -> PointEvidence:
    assert ego.T_camera_world is not None
    R = ego.T_camera_world.rotation
    depth = ego.T_camera_world.apply(motion.position)[:, 2]
    return PointEvidence(
        px=points.px,
        depth=np.where(np.isfinite(points.disparity), depth, np.nan),
        age_s=points.age,
        velocity=motion.velocity @ R.T,
        velocity_std=np.sqrt(np.maximum(np.einsum("nii->n", motion.covariance) / 3, 0.0)),
        significance=motion.significance,
        threshold=motion.threshold,
        dynamic=motion.dynamic | (_obstacle(points) != NO_OBSTACLE),
        neighbours=motion.neighbours,
        obstacle_id=_obstacle(points),
        cornered=points.cornered,
        recurs=points.recurs,
        on_outline=points.within != NO_OBSTACLE,
    )


def _obstacle(points: TrackedPoints) -> NDArray[np.int64]:
    """(N,) the obstacle that each point belongs to, or on whose outline it is seen."""
    on_outline = np.maximum(points.within, NO_OBSTACLE)
    return np.where(points.obstacle != NO_OBSTACLE, points.obstacle, on_outline)


def stereo_rows(points: TrackedPoints, camera: StereoCamera, bias_px: float) -> StereoRows:
    """Return where the points were matched in the right image, to check the calibration.

    Args:
        bias_px: added to all disparities at the image's centre; it is subtracted again here.
    """
    offset = np.asarray(points.px[:, 1] - points.right_px[:, 1], dtype=np.float64)
    disparity = points.disparity
    if bias_px:
        disparity = disparity - bias_px * bias_profile(points.px, disparity, camera)
    return StereoRows(points.px.astype(np.float64), offset, disparity, points.number)
