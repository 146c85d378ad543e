"""The method as published: image transformation, optical flow, stereo, displacement over dt.

The newest pair (t+dt, "current") is compared with an earlier one (t, "previous") in the steps of
S. R. Sahoo and P. V. Manivannan, "A Hybrid Approach for Dynamic Observer to Detect and Track
Dynamic Obstacles". The camera's motion is a planar map of the image (affine, homography).
"""

from __future__ import annotations

from collections import deque
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.methods.contract import StageTimer, Step
from observer.methods.planar.clustering import detect_obstacles
from observer.methods.planar.ego_motion import (
    PlanarEgoMotion,
    decompose_affine,
    estimate_ego_motion,
)
from observer.methods.planar.image_transformation import TransformedPair, transform_images
from observer.methods.planar.matching import match_descriptors, track_features
from observer.methods.planar.motion import measure_motion
from observer.methods.planar.reporting import describe_obstacle
from observer.methods.planar.residual_flow import residual_flow
from observer.methods.planar.results import Detection, PointMotions, ResidualFlow
from observer.methods.planar.tracking import Tracker
from observer.parameters import Parameters
from observer.trace import Trace
from observer.types import EgoMotion, Image, Matches, Obstacle
from observer.vision.features import Features, detect_features
from observer.vision.lifecycle import TrackIds
from observer.vision.motion_gate import ImageReach, MotionGate
from observer.vision.stereo import disparity_around, disparity_map, sample_disparity
from observer.vision.view import View

# Frames: the largest ``frames.interval``.
_HISTORY = 10


@dataclass(frozen=True, eq=False)
class _Seen:
    """A view and the camera pose it was taken from."""

    view: View
    T_world_camera: Pose


class PlanarMethod:
    """Steps 2 to 9 of the paper (see ``observer.methods.contract.Method``)."""

    def __init__(self, camera: StereoCamera, view: View, numbers: TrackIds | None = None) -> None:
        """Start a new world at ``view``; ``numbers`` supplies the ids of tracks."""
        self._camera = camera
        self._tracker = Tracker(numbers)
        self._history = deque([_Seen(view, Pose.identity())], maxlen=_HISTORY)
        self._gate = MotionGate()

    def step(self, view: View, parameters: Parameters, timer: StageTimer, trace: Trace) -> Step:
        """Compare this view with the one ``frames.interval`` before it."""
        p, camera = parameters, self._camera
        seen = self._history[-min(p.frames.interval, len(self._history))]
        previous, dt = seen.view, view.time - seen.view.time
        with timer("features"):
            features = detect_features(previous.left, p.features)
        with timer("matching"):
            matches = _match(previous.left, view.left, features, p)
        with timer("stereo"):
            disparity = disparity_map(previous.left, previous.right, p.stereo)
            of_matches = sample_disparity(disparity, matches.previous)
        with timer("ego_motion"):
            ego = estimate_ego_motion(matches, of_matches, camera, p.ego_motion, view.index)
            ego = self._gated(ego, view, dt, of_matches, p)
        _keep_background(trace, previous, features, matches, disparity, ego)
        detections: tuple[Detection, ...] = ()
        if ego.homography is not None:
            with timer("image_transformation"):
                warped = transform_images(view.left, view.right, ego.homography)
            with timer("residual_flow"):
                flow = residual_flow(previous.left, warped.left, warped.valid, features.px, p.flow)
            with timer("stereo"):
                moved = flow.observed_px[flow.dynamic]
                warped_disparity = disparity_around(warped.left, warped.right, moved, p.stereo)
                before = sample_disparity(disparity, flow.px[flow.dynamic])
                after = sample_disparity(warped_disparity, moved)
            with timer("motion"):
                motions = measure_motion(flow, before, after, dt, ego, camera, p)
            with timer("clustering"):
                midpoint = previous.time + dt / 2
                detections = detect_obstacles(motions, midpoint, p.clustering, p.motion)
            _keep_motion(trace, warped, flow, warped_disparity, motions, detections)
        with timer("tracking"):
            T_world_camera, obstacles = self._track(seen, view, ego, detections, p)
        share = float(np.isfinite(of_matches).mean()) if len(of_matches) else 0.0
        return Step(ego, T_world_camera, obstacles, share, rows=None)

    def _gated(
        self, ego: PlanarEgoMotion, view: View, dt: float, disparity: Float64Array, p: Parameters
    ) -> PlanarEgoMotion:
        """Return the same motion, or a lost one if it contradicts the earlier motions."""
        if ego.T_current_previous is None:
            return ego
        reach = None
        if p.matching.method == "klt":
            follows = p.flow.window_px / 2 * 2**p.flow.pyramid_levels
            reach = ImageReach.of(self._camera, disparity, follows)
        reason = self._gate.refusal(
            view.time, dt, ego.T_current_previous, ego.pose_covariance, reach
        )
        return ego if reason is None else ego.refused(reason)

    def _track(
        self,
        seen: _Seen,
        view: View,
        ego: EgoMotion,
        detections: tuple[Detection, ...],
        p: Parameters,
    ) -> tuple[Pose | None, tuple[Obstacle, ...]]:
        """Assign detections to tracks, place them in the world, and remember this view."""
        T_world_camera = camera_velocity = None
        if ego.T_current_previous is not None:
            T_world_camera = seen.T_world_camera @ ego.T_current_previous.inverse()
            camera_velocity = -ego.T_current_previous.translation / (view.time - seen.view.time)
            self._history.append(_Seen(view, T_world_camera))
        # While the pose is unknown, tracking continues from the last known camera pose.
        T_track_camera = self._history[-1].T_world_camera
        tracks = self._tracker.update(detections, T_track_camera, view.time, p.tracking)
        return T_world_camera, tuple(
            describe_obstacle(track, T_track_camera, T_world_camera, camera_velocity, view.time)
            for track in tracks
        )


def _match(previous: Image, current: Image, features: Features, p: Parameters) -> Matches:
    if p.matching.method == "klt":
        return track_features(previous, current, features, p.matching, p.flow)
    found = detect_features(current, p.features)
    return match_descriptors(previous, current, features, found, p.matching)


def _keep_background(
    trace: Trace,
    previous: View,
    features: Features,
    matches: Matches,
    disparity: NDArray[np.float32],
    ego: EgoMotion,
) -> None:
    trace.keep("previous_time", previous.time)
    trace.keep("previous_left", previous.left)
    trace.keep("previous_right", previous.right)
    trace.keep("features_px", features.px)
    trace.keep("matches", matches)
    trace.keep("disparity", disparity)
    trace.keep("ego_motion", ego)
    if ego.homography is not None:
        trace.keep("decomposition", asdict(decompose_affine(ego.homography)))


def _keep_motion(
    trace: Trace,
    warped: TransformedPair,
    flow: ResidualFlow,
    warped_disparity: NDArray[np.float32],
    motions: PointMotions,
    detections: tuple[Detection, ...],
) -> None:
    trace.keep("warped_left", warped.left)
    trace.keep("warped_right", warped.right)
    trace.keep("flow_px", flow.px)
    trace.keep("flow_observed_px", flow.observed_px)
    trace.keep("flow_residual_px", flow.residual_px)
    trace.keep("dynamic", flow.dynamic)
    trace.keep("warped_disparity", warped_disparity)
    trace.keep("motions", motions)
    trace.keep("points_previous", motions.points_previous)
    trace.keep("points_current", motions.points_current)
    trace.keep("detections", detections)
