"""The obstacles of one camera: tracked, started, merged and ended, frame by frame."""

from __future__ import annotations

import numpy as np

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.methods.monocular.floating import alike_in_depth, floating, off_ground
from observer.methods.monocular.ground import GroundPlane, GroundView
from observer.methods.monocular.ground_tracking import GroundTracker
from observer.methods.monocular.inverse_depth import expected_sightings
from observer.methods.monocular.motion_test import RayEvidence
from observer.methods.monocular.rays import RayPoints
from observer.methods.monocular.reporting import describe_ground_track
from observer.parameters import Parameters
from observer.types import Image, Obstacle
from observer.vision.lifecycle import NO_OBSTACLE, TrackIds, while_lost
from observer.vision.neighbourhoods import grouped

# A floating group has at least this many points.
_LEAST_FLOATING = 4


class GroundObstacles:
    """Obstacles on the ground; there are none while the ground plane is unknown."""

    def __init__(
        self, camera: StereoCamera, ground: GroundPlane | None, numbers: TrackIds | None
    ) -> None:
        self._camera = camera
        self._ground = ground
        self._tracker = GroundTracker(numbers)

    def boxes_px(self) -> Float64Array:
        """(B, 4) pixels, around all obstacles seen in this frame."""
        return self._tracker.boxes_px()

    def step(
        self,
        points: RayPoints,
        evidence: RayEvidence,
        image: Image,
        T_world_camera: Pose,
        T_before_world: Pose,
        dt: float,
        p: Parameters,
    ) -> RayPoints:
        """Process one frame; return the points with the obstacles they belong to.

        Args:
            image: (H, W) grey. T_world_camera: the pose now; T_before_world: of the frame before.
        """
        tracker, q = self._tracker, p.monocular
        if self._ground is None:
            return points
        view = GroundView(self._ground, T_world_camera, self._camera)
        now = expected_sightings(points, T_world_camera.inverse(), self._camera).px
        standing_flow = now - expected_sightings(points, T_before_world, self._camera).px
        points = tracker.follow(
            points, evidence.significance, evidence.threshold, standing_flow, image, view, dt,
            q, p.obstacles,
        )  # fmt: skip
        free = evidence.moving & (points.obstacle == NO_OBSTACLE)
        groups = grouped(evidence.pairs, free, p.obstacles.min_points)
        points = tracker.found(points, groups, evidence.significance, False, image, view, q)
        clear, inverse = off_ground(points, view)
        groups = grouped(alike_in_depth(evidence.pairs, inverse), clear, _LEAST_FLOATING)
        groups, significance = floating(points, groups, inverse, image, view, q)
        points = tracker.found(points, groups, significance, True, image, view, q)
        return tracker.live(tracker.merge(points, view), view, q, p.obstacles)

    def described(
        self,
        T_world_camera: Pose,
        camera_velocity: Float64Array,
        scale_sigma: float,
        time: float,
        p: Parameters,
    ) -> tuple[Obstacle, ...]:
        """Return all obstacles as reported; see ``describe_ground_track``."""
        if self._ground is None:
            return ()
        view = GroundView(self._ground, T_world_camera, self._camera)
        return tuple(
            describe_ground_track(track, view, camera_velocity, scale_sigma, time, p.monocular)
            for track in self._tracker.tracks
        )

    def unseen(
        self, T_world_camera: Pose, before: float, time: float, p: Parameters
    ) -> tuple[Obstacle, ...]:
        """Return all obstacles at a frame without a pose.

        Args:
            T_world_camera: the last known pose, of the frame at ``before``, seconds.
            time: of this frame, seconds.
        """
        last = self.described(T_world_camera, np.zeros(3), 0.0, before, p)
        missed = [track.missed_s for track in self._tracker.tracks]
        return while_lost(zip(last, missed, strict=True), time - before, p.obstacles.coast_s)
