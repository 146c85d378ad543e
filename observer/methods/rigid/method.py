"""Motion in space: points are tracked in both cameras and judged by their world position.

The camera's own motion between two frames is the rigid motion that keeps the static points in
place; groups of neighbouring points that move together relative to them are dynamic obstacles.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.methods.contract import StageTimer, Step
from observer.methods.rigid.bodies.expectation import expected_at
from observer.methods.rigid.bodies.reporting import describe_body
from observer.methods.rigid.bodies.segment_tracking import noted_within
from observer.methods.rigid.bodies.tentative import moving_boxes_px
from observer.methods.rigid.bodies.tracker import BodyTracker
from observer.methods.rigid.camera_step import CameraStep
from observer.methods.rigid.dense.scene import DenseVision
from observer.methods.rigid.ego_motion import StaticScene, estimate_rigid_motion
from observer.methods.rigid.motion_test import pooled_motion
from observer.methods.rigid.point_renewal import PointRenewal
from observer.methods.rigid.point_tracking import (
    Expectation,
    expected_view,
    sighted_points,
    track_in_both_cameras,
    world_sightings,
)
from observer.methods.rigid.stereo_drift import StereoDrift, with_bias
from observer.methods.rigid.trace import keep_background, keep_motion, stereo_rows
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.methods.rigid.unseen import UnseenRegions
from observer.mount import CameraMount
from observer.parameters import Parameters
from observer.trace import Trace
from observer.types import Obstacle, Unseen
from observer.vision.camera_rate import CameraRate
from observer.vision.keypoints import density_weights, has_corner
from observer.vision.klt_tracking import FIRST_LEVELS, LEVELS
from observer.vision.lifecycle import TrackIds, while_lost
from observer.vision.motion_gate import ImageReach, MotionGate
from observer.vision.rigid_ego_motion import RigidEgoMotion
from observer.vision.view import StereoRows, View
from observer.vision.wheel_odometry import agrees

# Weight of the newest frame in the noise learnt from the background.
_NOISE_GAIN = 0.3
# Share of the usual matches in the right image, below which that image counts as bad.
_FAILED_SHARE = 0.5


class RigidMethod:
    """Holds the tracked points, the obstacles and the camera's pose of one segment.

    See ``observer.methods.contract.Method``.
    """

    def __init__(
        self,
        camera: StereoCamera,
        view: View,
        parameters: Parameters,
        numbers: TrackIds | None = None,
        mount: CameraMount | None = None,
        drift: StereoDrift | None = None,
    ) -> None:
        """Start a new world at ``view``.

        Args:
            numbers: supplies the ids of tracks.
            mount: gives the ground's position and relates wheel odometry to the camera; without
                it the ground is found once it is seen.
            drift: what was learnt about the stereo pair in earlier segments; nothing if left out.
        """
        self._camera = camera
        self._mount = mount
        self._tracker = BodyTracker(numbers)
        self._renewal = PointRenewal(camera)
        self._gate = MotionGate()
        self._dense = DenseVision(camera, mount)
        self._unseen = UnseenRegions(camera)
        # Of the last frame whose dense depth is known.
        self._unseen_now: Unseen | None = None
        self._points = TrackedPoints.none()
        self._drift = StereoDrift(camera) if drift is None else drift
        self._drift.begin_segment()
        self._view = self._drift.timed(view)
        # The last frame whose pose is known; None while that is still the first frame.
        self._last: CameraStep | None = None
        # Standard deviation of the sightings, relative to that predicted from the texture.
        self._noise = 1.0
        # Share of the points whose depth was known in the last frame with a good right image, and
        # whether the newest right image is bad.
        self._usual_share, self._right_failed = 0.0, False
        self._renew_points(parameters)

    def step(self, view: View, parameters: Parameters, timer: StageTimer, trace: Trace) -> Step:
        """Compare this view with the last one whose pose is known."""
        previous, before, p = self._view, self._points, self._drift.remaining(parameters)
        given, view = view, self._drift.timed(view)
        dt = view.time - previous.time
        with timer("klt_tracking"):
            T_expected = self._expected_pose(dt)
            expected = self._expectation(T_expected, dt, p)
            levels = FIRST_LEVELS if self._last is None else LEVELS
            seen = track_in_both_cameras(
                before, previous, view, expected, dt, levels, p.klt_tracking
            )
            bias_px = self._drift.bias_px
            points, sigma = sighted_points(
                before, seen, expected, view, dt, p.klt_tracking, self._camera, bias_px
            )
            self._note_matches(points.stereo_share)
        with timer("ego_motion"):
            ego = self._ego_motion(points, sigma, T_expected, view, dt, p)
        rows = stereo_rows(points, self._camera, bias_px)
        keep_background(trace, previous, before, points, seen, ego, rows)
        now = CameraStep.of(self._camera, ego, dt)
        if now is None:
            return Step(ego, None, self._coasting(view.time, p), points.stereo_share, rows)
        with timer("motion"):
            # The background's residuals show the noise of all sightings.
            scale = max(ego.noise_scale, p.evidence.least_noise)
            self._noise += _NOISE_GAIN * (scale - self._noise)
            T_world_camera = now.T_world_camera
            sightings = world_sightings(points, sigma * self._noise, T_world_camera, self._camera)
            points = points.sighted(sightings, dt, p.evidence.memory_s)
            points = points.but(cornered=has_corner(view.left, points.px))
            motion = pooled_motion(points, now, p.evidence)
            points = points.but(dynamic=motion.dynamic, velocity=motion.own_velocity)
        with timer("dense"):
            due = self._dense.is_due(view.time, dt, p.dense)
            scene = self._dense.look(view, now, p.stereo, bias_px) if due else None
        with timer("tracking"):
            points = self._tracker.step(points, sightings, motion, scene, now, p)
        keep_motion(trace, before, points, seen, ego, motion)
        self._view, self._points, self._last = view, points, now
        with timer("drift"):
            notes = self._follow_drift(given, before, seen.found, rows, p, trace)
        obstacles = self._described(now)
        with timer("unseen"):
            if due:
                boxes = moving_boxes_px(self._tracker.tracks, scene, now)
                self._unseen_now = self._unseen.look(view, scene, points, *boxes, p.stereo)
            elif p.dense.rate_hz == 0:
                self._unseen_now = None
        trace.keep("unseen", self._unseen_now)
        with timer("features"):
            self._renew_points(p)
        share = points.stereo_share
        return Step(ego, T_world_camera, obstacles, share, rows, self._unseen_now, notes=notes)

    # --- the steps ---------------------------------------------------------------------------

    @property
    def _T_camera_world(self) -> Pose:
        return Pose.identity() if self._last is None else self._last.T_camera_world

    @property
    def _rate(self) -> CameraRate | None:
        return None if self._last is None else self._last.rate

    def _expected_pose(self, dt: float) -> Pose:
        """``T_camera_world`` after ``dt`` more seconds at the last frame's rate."""
        if self._last is None:
            return Pose.identity()
        return self._last.rate.over(dt) @ self._last.T_camera_world

    def _expectation(self, T_expected: Pose, dt: float, p: Parameters) -> Expectation:
        """Predict each point: static ones stay in place, those of bodies move with them."""
        place, _ = self._points.sums.static_position()
        body = expected_at(self._tracker.tracks, self._points, place, dt, p.obstacles)
        place = np.where(np.isfinite(body), body, place)
        return expected_view(
            self._points, place, T_expected, self._camera, regain=self._right_failed
        )

    def _note_matches(self, share: float) -> None:
        """Note the share of points with depth: a sudden loss is the right image's failure."""
        self._right_failed = share < _FAILED_SHARE * self._usual_share
        if not self._right_failed:
            self._usual_share = share

    def _ego_motion(
        self,
        points: TrackedPoints,
        sigma: Float64Array,
        T_expected: Pose,
        view: View,
        dt: float,
        p: Parameters,
    ) -> RigidEgoMotion:
        """Estimate the camera's motion from all points not known to move, if there are enough."""
        place, place_cov = points.sums.static_position()
        known = self._tracker.known(points)
        if np.count_nonzero(known) > len(points) / 2:
            # One obstacle may have been mistaken for the background, but not what is seen to move
            # before it: a group of people may fill the view.
            known = self._tracker.seen_apart(points)
        chosen = np.flatnonzero(~known)
        px = points.px[chosen]
        scene = StaticScene(
            position=place.take(chosen, axis=0),
            covariance=place_cov.take(chosen, axis=0),
            px=px.astype(np.float64),
            disparity=points.disparity[chosen],
            sigma=sigma.take(chosen, axis=0),
            weight=density_weights(px, p.klt_tracking),
        )
        ego = estimate_rigid_motion(
            scene,
            self._T_camera_world,
            T_expected,
            self._camera,
            p.ego_motion,
            view.index,
            lambda step: self._driven_like(step, view, dt),
        )
        inliers = np.zeros(len(points), np.bool_)
        inliers[chosen] = ego.inliers
        return self._gated(replace(ego, inliers=inliers), points, view.time, dt, p)

    def _driven_like(self, T_current_previous: Pose, view: View, dt: float) -> bool:
        """Return whether wheel odometry agrees with this motion since the last known pose."""
        if self._mount is None:
            return False
        before, now = self._view.odometry, view.odometry
        return agrees(T_current_previous, before, now, self._mount, dt)

    def _gated(
        self, ego: RigidEgoMotion, points: TrackedPoints, time: float, dt: float, p: Parameters
    ) -> RigidEgoMotion:
        """Return the same motion, or a lost one if it contradicts the earlier motions."""
        if ego.T_current_previous is None:
            return ego
        reach = None
        if self._last is not None:
            follows = p.klt_tracking.window_px / 2 * 2**LEVELS
            reach = ImageReach.of(self._camera, points.disparity, follows)
        reason = self._gate.refusal(time, dt, ego.T_current_previous, ego.pose_covariance, reach)
        return ego if reason is None else ego.refused(reason)

    def _follow_drift(
        self,
        given: View,
        before: TrackedPoints,
        found: NDArray[np.bool_],
        rows: StereoRows,
        p: Parameters,
        trace: Trace,
    ) -> tuple[str, ...]:
        """Learn bias and skew of the pair, correcting points and obstacles for any change."""
        now = self._last
        assert now is not None
        change = self._drift.learn(given, before, found, self._points, rows, now, p, trace)
        if change is None:
            return ()
        if change.bias_px:
            self._points = with_bias(self._points, change.bias_px, now)
            self._tracker.correct_disparities(change.bias_px, now)
            self._dense.correct_disparities(change.bias_px)
        if change.skew:
            # While the camera turned, all depths were wrong, differently in each frame.
            self._view = self._drift.timed(given)
            self._points = self._renewal.restarted(
                self._points, self._view, now.T_camera_world, self._drift.bias_px
            )
            self._tracker.tracks.clear()
            self._dense.forget()
        return change.notes

    def _renew_points(self, p: Parameters) -> None:
        T_camera_world = self._T_camera_world
        boxes = self._tracker.boxes_px(T_camera_world, self._camera)
        points = self._renewal.renewed(
            self._points, self._view, boxes, T_camera_world, self._rate, p, self._drift.bias_px
        )
        self._points = noted_within(points, self._tracker.tracks)

    # --- what is reported --------------------------------------------------------------------

    def _described(self, now: CameraStep) -> tuple[Obstacle, ...]:
        return tuple(
            describe_body(track, now.T_world_camera, -now.rate.shift, self._view.time)
            for track in self._tracker.tracks
        )

    def _coasting(self, time: float, p: Parameters) -> tuple[Obstacle, ...]:
        """Return the obstacles at a frame without a pose; ``time`` is the source's, seconds."""
        before, T_world_camera = self._view.time, self._T_camera_world.inverse()
        last = [
            (describe_body(track, T_world_camera, np.zeros(3), before), track.missed_s)
            for track in self._tracker.tracks
        ]
        return while_lost(last, time - before, p.obstacles.coast_s)
