"""Renewal of the tracked points: drop wrong ones, and give every empty cell a new one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.methods.rigid.point_tracking import (
    LEAST_DISPARITY_PX,
    MOST_NEGATIVE_PX,
    sightings_at,
)
from observer.methods.rigid.position_velocity_filter import PositionVelocityFilter
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.parameters import Parameters
from observer.vision.camera_rate import CameraRate
from observer.vision.disparity_bias import bias_profile
from observer.vision.keypoints import attention, grid_cells, new_keypoints, one_per_cell
from observer.vision.klt_tracking import TYPICAL_SIGMA_PX, match_right
from observer.vision.lifecycle import NO_OBSTACLE
from observer.vision.sparse_stereo import RowMatches, RowSearch
from observer.vision.view import View


class PointRenewal:
    """Keeps the image covered with points, and numbers them."""

    def __init__(self, camera: StereoCamera) -> None:
        self._camera = camera
        self._next_number = 0

    def renewed(
        self,
        points: TrackedPoints,
        view: View,
        boxes_px: Float64Array,
        T_camera_world: Pose,
        rate: CameraRate | None,
        parameters: Parameters,
        bias_px: float,
    ) -> TrackedPoints:
        """Return one point for each cell of the image: the old one, or else a new one.

        Args:
            boxes_px: (B, 4) u0 v0 u1 v1 around obstacles; cells are smaller there.
            rate: of the camera; None = unknown, as in a segment's first view, where every cell
                is searched.
            bias_px: to be added to all disparities, pixels at the image's centre.
        """
        points = points.remembered()
        moving = points.px[points.dynamic | (points.obstacle != NO_OBSTACLE)]
        size = (self._camera.width, self._camera.height)
        marked = attention(size, boxes_px, moving, parameters.klt_tracking)
        cell = grid_cells(points.px, marked, parameters.klt_tracking)
        kept = one_per_cell(cell, points.sightings)
        points = points.take(kept)
        turn = None if rate is None else view.index
        px = new_keypoints(view.left, cell[kept], marked, parameters, turn)
        due = np.flatnonzero(points.sightings == parameters.evidence.min_sightings)
        if len(px) == 0 and len(due) == 0:
            return points
        rows = RowSearch.of(view.left, view.right, parameters.stereo)
        # By the time a point is about to be judged, its surroundings have shifted.
        judged = points.px[due]
        wrong = due[rows.contradicts(judged, judged[:, 0] - points.right_px[due, 0])]
        if len(wrong):
            points = points.take(np.delete(np.arange(len(points)), wrong))
        matches = rows.matches(px)
        new = self._spawned(view, px, matches, T_camera_world, rate, parameters, bias_px)
        return points.joined(new)

    def restarted(
        self, points: TrackedPoints, view: View, T_camera_world: Pose, bias_px: float
    ) -> TrackedPoints:
        """Return the points as if first seen in this view, now that its skew is known."""
        disparity = (points.px[:, 0] - points.right_px[:, 0]).astype(np.float64)
        known = np.asarray(disparity > MOST_NEGATIVE_PX)
        points, disparity = points.take(known), disparity[known]
        disparity = disparity + _skew_s(view) * points.flow[:, 0]
        started = self._start_points(points.px, points.right_px, disparity, T_camera_world, bias_px)
        return started.but(number=points.number, flow=points.flow, recurs=points.recurs)

    def _spawned(
        self,
        view: View,
        px: NDArray[np.float32],
        matches: RowMatches,
        T_camera_world: Pose,
        rate: CameraRate | None,
        parameters: Parameters,
        bias_px: float,
    ) -> TrackedPoints:
        """Return new points at those of (N, 2) px that are found in the right image."""
        images, coarse = (view.left, view.right), matches.disparity
        right, _ = match_right(images, px, coarse, parameters.klt_tracking)
        disparity = (px[:, 0] - right[:, 0]).astype(np.float64)
        known = np.asarray(disparity > MOST_NEGATIVE_PX)
        px, right = px[known], right[known]
        disparity = np.maximum(disparity[known], LEAST_DISPARITY_PX)
        skew_s = _skew_s(view)
        if skew_s and rate is not None:
            disparity = disparity + skew_s * rate.static_flow(px, disparity, self._camera)[:, 0]
        started = self._start_points(px, right, disparity, T_camera_world, bias_px)
        self._next_number += len(px)
        return started.but(recurs=matches.recurs[known])

    def _start_points(
        self,
        px: NDArray[np.float32],
        right: NDArray[np.float32],
        disparity: Float64Array,
        T_camera_world: Pose,
        bias_px: float,
    ) -> TrackedPoints:
        """Return points first seen at (N, 2) px, with disparities (N,) px at the left exposure."""
        if bias_px:
            disparity = disparity + bias_px * bias_profile(px, disparity, self._camera)
        disparity = np.maximum(disparity, LEAST_DISPARITY_PX)
        sigma, unknown = np.full((len(px), 3), TYPICAL_SIGMA_PX), np.full((len(px), 3), np.nan)
        T_world_camera = T_camera_world.inverse()
        first = sightings_at(px, disparity, sigma, unknown, T_world_camera, self._camera)
        sums = PositionVelocityFilter.begin(first.position, first.information)
        return TrackedPoints.begin(self._next_number, px, right, disparity, sums)


def _skew_s(view: View) -> float:
    """Return the seconds by which the right camera exposes later; 0 if unknown."""
    return 0.0 if view.right_time is None else view.right_time - view.time
